/* Forks while another thread opens, uses and closes the board repeatedly. In each child the library either works
 * completely, or every call fails at once with the reason. No child hangs, neither in a call nor at its exit. */
#define _DEFAULT_SOURCE
#include "check.h"

#include <pthread.h>
#include <sys/wait.h>
#include <unistd.h>

enum { CHILDREN = 60 };

static volatile int is_over;

static void *changer(void *unused)
{
    static transData mine[DEF_MA_MAX];
    (void)unused;
    while (!is_over) {
        OpenECMUSB();
        ECMUSBRead((unsigned char *)mine, sizeof mine);
        CloseECMUSB();
        ECMUSBRead((unsigned char *)mine, sizeof mine);
    }
    return NULL;
}

static void child_uses_it(void)
{
    alarm(20);
    if (OpenECMUSB()) {
        CHECK(read_response());
    } else {
        CHECK(strstr(ecmsk_last_error(), "forked") != NULL);
        CHECK(!read_response());
        CHECK(!write_command());
        CHECK(strstr(ecmsk_last_error(), "forked") != NULL);
    }
    CloseECMUSB();
    exit(0);
}

int main(void)
{
    pthread_t thread;
    int i;

    CHECK(pthread_create(&thread, NULL, changer, NULL) == 0);
    for (i = 0; i < CHILDREN; i++) {
        int status = -1;
        pid_t child = fork();
        CHECK(child >= 0);
        if (child == 0) {
            child_uses_it();
        }
        CHECK(waitpid(child, &status, 0) == child);
        CHECK(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    }
    is_over = 1;
    CHECK(pthread_join(thread, NULL) == 0);
    puts("ok");
    return 0;
}
