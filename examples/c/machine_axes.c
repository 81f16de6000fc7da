/* What a machine file says: its axes with their units and limits, and where a position in units is in counts. It opens no
 * board. The argument is the file: machine_axes machine.toml */
#include "ecmsk.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* Ends the program with the reason if a call has failed. */
static void Must(ecmsk_result result)
{
    if (result != ECMSK_OK) {
        fprintf(stderr, "%s\n", ecmsk_last_error());
        exit(1);
    }
}

int main(int argc, char **argv)
{
    ecmsk_machine *machine = NULL;
    uint32_t axes = 0;
    Must(ecmsk_machine_open(argc > 1 ? argv[1] : "machine.toml", &machine));
    Must(ecmsk_machine_get_axis_count(machine, &axes));

    for (uint32_t index = 0; index < axes; index++) {
        char name[129], unit[16];
        int64_t counts = 0;
        ecmsk_axis axis = {.size = sizeof axis};
        Must(ecmsk_machine_get_axis(machine, index, &axis));
        Must(ecmsk_machine_get_axis_name(machine, index, name, sizeof name, NULL));
        Must(ecmsk_machine_get_axis_unit(machine, index, unit, sizeof unit, NULL));

        printf("%s: slave %u, %.6g counts per %s", name, (unsigned)axis.slave, axis.counts_per_unit, unit);
        if (isfinite(axis.min_units))
            printf(", from %.6g", axis.min_units);
        if (isfinite(axis.max_units))
            printf(", to %.6g", axis.max_units);
        if (isfinite(axis.max_velocity))
            printf(", at most %.6g %s/s", axis.max_velocity, unit);

        /* Without a limit the counts are those of 32 bits, so that this is right for every axis. */
        Must(ecmsk_machine_to_counts(machine, index, 100.0, &counts));
        printf("; 100 %s are %lld counts%s\n", unit, (long long)counts,
               counts < axis.min_counts || counts > axis.max_counts ? ", beyond its limits" : "");
    }
    Must(ecmsk_machine_close(machine));
    return 0;
}
