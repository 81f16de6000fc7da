/* 40 drives, switched on, that get a target in each cycle of 1 ms, on SOEM. It says `begin` before the cycles that are measured,
 * and `end` behind them. Arguments: the network interface. */

#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ethercat.h"

enum { DRIVES = 40, WARM_UP = 500, MEASURED = 2000, SWITCHING = 300, STEP = 20, STROKE = 1000, CYCLE_NS = 1000000 };

static char image[4096];
static ec_slavet slaves[DRIVES + 1];
static int found;
static ec_groupt groups[2];
static uint8 eeprom[EC_MAXEEPBUF];
static uint32 eeprom_map[EC_MAXEEPBITMAP];
static ec_eringt errors;
static ec_idxstackT indexes;
static boolean has_error;
static int64 dc_time;
static ec_SMcommtypet manager_types[EC_MAX_MAPT];
static ec_PDOassignt assigned[EC_MAX_MAPT];
static ec_PDOdesct described[EC_MAX_MAPT];
static ec_eepromSMt eeprom_managers;
static ec_eepromFMMUt eeprom_fmmus;
static ecx_portt port;
static ecx_contextt soem = {
    .port = &port, .slavelist = slaves, .slavecount = &found, .maxslave = DRIVES + 1, .grouplist = groups, .maxgroup = 2,
    .esibuf = eeprom, .esimap = eeprom_map, .elist = &errors, .idxstack = &indexes, .ecaterror = &has_error, .DCtime = &dc_time,
    .SMcommtype = manager_types, .PDOassign = assigned, .PDOdesc = described, .eepSM = &eeprom_managers, .eepFMMU = &eeprom_fmmus,
};
static struct timespec due;
static int lost;

static void fail(const char *what) {
    fprintf(stderr, "%s\n", what);
    exit(1);
}

/* The outputs of a drive are a controlword and a target, its inputs begin with the statusword. */
static void cycle(unsigned controlword, int target) {
    for (int n = 1; n <= DRIVES; n++) {
        unsigned char *outputs = slaves[n].outputs;
        outputs[0] = controlword;
        outputs[1] = controlword >> 8;
        for (int byte = 0; byte < 4; byte++) outputs[2 + byte] = (unsigned)target >> 8 * byte;
    }
    due.tv_nsec += CYCLE_NS;
    if (due.tv_nsec >= 1000000000) {
        due.tv_nsec -= 1000000000;
        due.tv_sec++;
    }
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
    ecx_send_processdata(&soem);
    if (ecx_receive_processdata(&soem, EC_TIMEOUTRET) != 3 * DRIVES) lost++;
}

int main(int count, char **words) {
    if (count != 2 || !ecx_init(&soem, words[1])) fail("the interface cannot be used");
    if (ecx_config_init(&soem, FALSE) != DRIVES) fail("the drives are not there");
    ecx_config_map_group(&soem, image, 0);
    ecx_configdc(&soem);
    ecx_statecheck(&soem, 0, EC_STATE_SAFE_OP, EC_TIMEOUTSTATE * 4);
    clock_gettime(CLOCK_MONOTONIC, &due);
    ecx_send_processdata(&soem);
    ecx_receive_processdata(&soem, EC_TIMEOUTRET);
    slaves[0].state = EC_STATE_OPERATIONAL;
    ecx_writestate(&soem, 0);
    for (int tries = 0; tries < 1000 && ecx_statecheck(&soem, 0, EC_STATE_OPERATIONAL, 1000) != EC_STATE_OPERATIONAL; tries++) {
        ecx_send_processdata(&soem);
        ecx_receive_processdata(&soem, EC_TIMEOUTRET);
    }
    if (slaves[0].state != EC_STATE_OPERATIONAL) fail("the drives do not come to OP");
    const unsigned steps[] = {0x06, 0x07, 0x0F};
    clock_gettime(CLOCK_MONOTONIC, &due);
    for (int step = 0; step < 3; step++)
        for (int n = 0; n < SWITCHING; n++) cycle(steps[step], 0);
    for (int n = 1; n <= DRIVES; n++)
        if ((slaves[n].inputs[0] & 0x6F) != 0x27) fail("a drive is not on");
    int target = 0;
    for (int n = 0; n < WARM_UP + MEASURED; n++) {
        if (n == WARM_UP) {
            puts("begin");
            fflush(stdout);
        }
        target += n % (2 * STROKE) < STROKE ? STEP : -STEP;
        cycle(0x0F, target);
    }
    if (lost > MEASURED / 10) fail("many answers did not come in time: keep the machine quiet");
    puts("end");
    fflush(stdout);
    /* What is read of its threads is read before it ends. */
    getchar();
    return 0;
}
