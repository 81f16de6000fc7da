/* An open that fails: false, a text that says why in every thread, and the next calls are false too.
 * Arguments: parts of the text. */
#include "check.h"

#include <pthread.h>

static void *in_another_thread(void *unused)
{
    static char text[1000];
    (void)unused;
    strncpy(text, ecmsk_last_error(), sizeof text - 1);
    return text;
}

int main(int count, char **arguments)
{
    pthread_t thread;
    void *told = NULL;
    int i;

    for (i = 0; i < 3; i++) {
        CHECK(!OpenECMUSB());
    }
    CHECK(ecmsk_last_error()[0] != 0);
    CHECK(pthread_create(&thread, NULL, in_another_thread, NULL) == 0);
    CHECK(pthread_join(thread, &told) == 0);
    CHECK(strcmp((const char *)told, ecmsk_last_error()) == 0);
    for (i = 1; i < count; i++) {
        CHECK(last_error_has(arguments[i]));
    }
    CHECK(!read_response());
    CHECK(!write_command());
    CloseECMUSB();
    puts("ok");
    return 0;
}
