/* Prints the link that OpenECMUSB opens, or why it opens none. */
#include "check.h"

int main(void)
{
    char name[500];
    if (!OpenECMUSB()) {
        puts(ecmsk_last_error());
        return 1;
    }
    CHECK(ecmsk_get_link_name(ecmsk_vendor_board(), name, sizeof name, NULL) == ECMSK_OK);
    puts(name);
    return 0;
}
