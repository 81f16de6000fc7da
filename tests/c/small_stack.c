/* A thread with as little stack as the system allows, 16 kB, writes and reads: the vendor's library needs as much. */
#define _GNU_SOURCE
#include "check.h"

#include <pthread.h>
#include <sys/mman.h>

enum { STACK = 16 * 1024, PAGE = 4096 };

/* Returns the line that does not hold: there is no stack to print it. */
#define NEED(holds)                     \
    do {                                \
        if (!(holds)) {                 \
            return (void *)(long)__LINE__; \
        }                               \
    } while (0)

static void *use(void *unused)
{
    static unsigned char frame[512];
    int i;
    (void)unused;
    for (i = 0; i < 100; i++) {
        NEED(ECMUSBWrite(frame, 504));
        NEED(ECMUSBRead(frame, 504));
        memset(frame, 0, sizeof frame);
        frame[0] = i == 10 ? SET_STATE : 0;
        frame[4] = i == 10 ? STATE_OPERATIONAL : 0;
    }
    NEED(!ECMUSBRead(NULL, 504));
    frame[0] = SW_RESET;
    NEED(ECMUSBWrite(frame, 504));
    return NULL;
}

int main(void)
{
    pthread_attr_t attributes;
    pthread_t thread;
    void *line = NULL;
    /* Bytes below the stack are inaccessible. */
    char *memory = (char *)mmap(NULL, PAGE + STACK, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);

    CHECK(memory != MAP_FAILED && mprotect(memory, PAGE, PROT_NONE) == 0);
    CHECK(OpenECMUSB());
    CHECK(pthread_attr_init(&attributes) == 0);
    CHECK(pthread_attr_setstack(&attributes, memory + PAGE, STACK) == 0);
    CHECK(pthread_create(&thread, &attributes, use, NULL) == 0);
    CHECK(pthread_join(thread, &line) == 0);
    if (line != NULL) {
        fprintf(stderr, "line %ld does not hold\n", (long)line);
        return 1;
    }
    CloseECMUSB();
    puts("ok");
    return 0;
}
