/* Programs that end without Close. Argument: how.
 * return: main returns while another thread is blocked in a read; exit: another thread calls exit; fork: a child ends
 * first, and its parent's board goes on; moves: 100 frames each way, then main returns. */
#define _DEFAULT_SOURCE
#include "check.h"

#include <pthread.h>
#include <sys/wait.h>
#include <unistd.h>

static void *reader(void *unused)
{
    static transData mine[DEF_MA_MAX];
    (void)unused;
    while (ECMUSBRead((unsigned char *)mine, sizeof mine)) {
    }
    return NULL;
}

static void *ender(void *unused)
{
    (void)unused;
    exit(0);
}

int main(int count, char **arguments)
{
    pthread_t thread;
    const char *how = count > 1 ? arguments[1] : "";

    CHECK(OpenECMUSB());
    CHECK(read_response());
    if (strcmp(how, "fork") == 0) {
        int status = -1;
        pid_t child = fork();
        if (child == 0) {
            exit(7);
        }
        CHECK(child > 0);
        CHECK(waitpid(child, &status, 0) == child);
        CHECK(WIFEXITED(status) && WEXITSTATUS(status) == 7);
        CHECK(read_response());
        CHECK(write_command());
    } else if (strcmp(how, "moves") == 0) {
        int i;
        for (i = 0; i < 100; i++) {
            CHECK(write_command());
            CHECK(i == 0 || read_response());
        }
    } else {
        CHECK(pthread_create(&thread, NULL, reader, NULL) == 0);
        if (strcmp(how, "exit") == 0) {
            CHECK(pthread_create(&thread, NULL, ender, NULL) == 0);
            CHECK(pthread_join(thread, NULL) == 0);
        }
    }
    puts("ok");
    return 0;
}
