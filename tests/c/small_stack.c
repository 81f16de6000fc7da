/* A thread with as little stack as the system allows, 16 kB, writes and reads: the vendor's library needs as much. */
#define _GNU_SOURCE
#include "check.h"

#include <pthread.h>
#include <sys/mman.h>

enum { STACK = 16 * 1024, PAGE = 4096 };

static void *use(void *unused)
{
    static unsigned char frame[512];
    int i;
    (void)unused;
    for (i = 0; i < 100; i++) {
        CHECK(ECMUSBWrite(frame, 504));
        CHECK(ECMUSBRead(frame, 504));
        memset(frame, 0, sizeof frame);
    }
    CHECK(!ECMUSBRead(NULL, 504));
    return NULL;
}

int main(void)
{
    pthread_attr_t attributes;
    pthread_t thread;
    /* Bytes below the stack are inaccessible. */
    char *memory = (char *)mmap(NULL, PAGE + STACK, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);

    CHECK(memory != MAP_FAILED && mprotect(memory, PAGE, PROT_NONE) == 0);
    CHECK(OpenECMUSB());
    CHECK(pthread_attr_init(&attributes) == 0);
    CHECK(pthread_attr_setstack(&attributes, memory + PAGE, STACK) == 0);
    CHECK(pthread_create(&thread, &attributes, use, NULL) == 0);
    CHECK(pthread_join(thread, NULL) == 0);
    CloseECMUSB();
    puts("ok");
    return 0;
}
