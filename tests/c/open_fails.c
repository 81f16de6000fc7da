/* An open that fails: false, a text that says why in every thread, and the next calls are false too. A later failure
 * has its own text there. Arguments: parts of the first text. */
#define _GNU_SOURCE
#include "check.h"

#include <pthread.h>

static pthread_barrier_t step;

static void *in_another_thread(void *texts)
{
    int i;
    for (i = 0; i < 2; i++) {
        pthread_barrier_wait(&step);
        strncpy((char *)texts + 1000 * i, ecmsk_last_error(), 999);
        pthread_barrier_wait(&step);
    }
    return NULL;
}

int main(int count, char **arguments)
{
    static char texts[2][1000];
    pthread_t thread;
    int i;

    CHECK(pthread_barrier_init(&step, NULL, 2) == 0);
    CHECK(pthread_create(&thread, NULL, in_another_thread, texts) == 0);
    for (i = 0; i < 3; i++) {
        CHECK(!OpenECMUSB());
    }
    pthread_barrier_wait(&step);
    pthread_barrier_wait(&step);
    CHECK(texts[0][0] != 0);
    CHECK(strcmp(texts[0], ecmsk_last_error()) == 0);
    for (i = 1; i < count; i++) {
        CHECK(last_error_has(arguments[i]));
    }
    CHECK(setenv("ECMSK_LINK", "another:", 1) == 0);
    CHECK(!OpenECMUSB());
    pthread_barrier_wait(&step);
    pthread_barrier_wait(&step);
    CHECK(pthread_join(thread, NULL) == 0);
    CHECK(strcmp(texts[0], texts[1]) != 0);
    CHECK(strcmp(texts[1], ecmsk_last_error()) == 0);
    CHECK(!read_response());
    CHECK(!write_command());
    CloseECMUSB();
    puts("ok");
    return 0;
}
