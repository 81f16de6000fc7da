/* The library loaded by name, as in other languages: the whole register of the returned bool is 0 or 1, and
 * unloading the library while its board is open does no harm. Argument: the library's file. */
#define _DEFAULT_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHECK(holds)                                                  \
    do {                                                              \
        if (!(holds)) {                                               \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #holds); \
            exit(1);                                                  \
        }                                                             \
    } while (0)

typedef unsigned (*open_function)(void);
typedef void (*close_function)(void);
typedef unsigned (*move_function)(unsigned char *, unsigned long);

static void *symbol(void *library, const char *name)
{
    void *address = dlsym(library, name);
    CHECK(address != NULL);
    return address;
}

int main(int count, char **arguments)
{
    unsigned char frame[512];
    void *library, *address;
    open_function open_it;
    close_function close_it;
    move_function write_it, read_it;
    int i;

    CHECK(count == 2);
    library = dlopen(arguments[1], RTLD_NOW);
    CHECK(library != NULL);
    address = symbol(library, "OpenECMUSB");
    memcpy(&open_it, &address, sizeof address);
    address = symbol(library, "CloseECMUSB");
    memcpy(&close_it, &address, sizeof address);
    address = symbol(library, "ECMUSBWrite");
    memcpy(&write_it, &address, sizeof address);
    address = symbol(library, "ECMUSBRead");
    memcpy(&read_it, &address, sizeof address);

    memset(frame, 0, sizeof frame);
    CHECK(read_it(frame, 512) == 0);
    CHECK(write_it(frame, 512) == 0);
    CHECK(open_it() == 1);
    CHECK(open_it() == 1);
    CHECK(write_it(frame, 512) == 1);
    CHECK(read_it(frame, 512) == 1);
    CHECK(write_it(NULL, 512) == 0);
    CHECK(read_it(NULL, 512) == 0);
    close_it();
    CHECK(write_it(frame, 512) == 0);

    for (i = 0; i < 5; i++) {
        CHECK(open_it() == 1);
        CHECK(dlclose(library) == 0);
        library = dlopen(arguments[1], RTLD_NOW);
        CHECK(library != NULL);
        CHECK(read_it(frame, 512) == 1);
    }
    CHECK(dlclose(library) == 0);
    puts("ok");
    return 0;
}
