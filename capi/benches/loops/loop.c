/* Loop.cs in C: the same calls on the same library. Argument `copies`: also what the assembly does beside them for its user, a
 * buffer of its own for each response and two copies of it. */
#define _POSIX_C_SOURCE 199309L
#include "NEXTWUSBLib.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

enum { LENGTH = DEF_MA_MAX * sizeof(transData), REPORT = 612 };

static transData cmdData[DEF_MA_MAX], respData[DEF_MA_MAX];
static unsigned char last[LENGTH];

static bool read_copies(void)
{
    unsigned char report[REPORT] = {0};
    bool is_read = ECMUSBRead(report, REPORT);
    memcpy(last, report, LENGTH);
    memcpy(respData, report, LENGTH);
    return is_read;
}

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec * 1e9 + (double)time.tv_nsec;
}

int main(int count, char **arguments)
{
    bool copies = count > 1 && strcmp(arguments[1], "copies") == 0;
    int rounds;
    if (!OpenECMUSB())
        return 1;
    while (scanf("%d", &rounds) == 1) {
        double start = now();
        for (int i = 0; i < rounds; i++) {
            cmdData[1].Data1 = (unsigned)i;
            bool both = ECMUSBWrite((unsigned char *)cmdData, LENGTH) &&
                        (copies ? read_copies() : ECMUSBRead((unsigned char *)respData, LENGTH));
            if (!both)
                return 1;
        }
        printf("%.1f\n", (now() - start) / rounds);
        fflush(stdout);
    }
    return 0;
}
