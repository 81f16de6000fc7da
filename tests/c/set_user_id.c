/* Prints, one per line, whether OpenECMUSB opens a board, and which one or why not; with an argument, the same for
 * ecmsk_open with that link. Installed set-user-ID root and run by another user. */
#include "check.h"

int main(int arguments, char **argument)
{
    char name[500];
    ecmsk_board *board = NULL;
    if (arguments > 1) {
        printf("ecmsk_open %s\n", ecmsk_open(argument[1], &board) == ECMSK_OK ? "open" : ecmsk_last_error());
        return 0;
    }
    if (!OpenECMUSB()) {
        printf("OpenECMUSB %s\n", ecmsk_last_error());
        return 0;
    }
    CHECK(ecmsk_get_link_name(ecmsk_vendor_board(), name, sizeof name, NULL) == ECMSK_OK);
    printf("OpenECMUSB opened %s\n", name);
    CloseECMUSB();
    return 0;
}
