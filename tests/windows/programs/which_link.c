/* Prints the link that OpenECMUSB opens, or why it opens none. Arguments: the DLL's path, then variables to set, as
 * NAME=VALUE. */
#include "loaded.h"

typedef void *(__cdecl *vendor_function)(void);
typedef int(__cdecl *name_function)(void *board, char *buffer, size_t length, size_t *needed);

int main(int count, char **arguments)
{
    static char name[500];
    HMODULE dll;
    int i;
    for (i = 2; i < count; i++) {
        char *value = strchr(arguments[i], '=');
        CHECK(value != NULL);
        *value++ = 0;
        CHECK(SetEnvironmentVariableA(arguments[i], value));
    }
    dll = load(arguments[1]);
    if (!open_board()) {
        puts(last_error());
        return 1;
    }
    CHECK(FUNCTION(name_function, dll, "ecmsk_get_link_name")(FUNCTION(vendor_function, dll, "ecmsk_vendor_board")(),
                                                              name, sizeof name, NULL) == 0);
    puts(name);
    close_board();
    return 0;
}
