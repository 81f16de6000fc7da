/* Eight threads make all calls at once. The results are not checked, only that all calls return, that nothing
 * crashes, that no byte beyond a buffer is accessed, and that the board works afterwards. */
#include "check.h"

#include <pthread.h>

enum { THREADS = 8, ROUNDS = 3000 };

static const char *const uri = "sim:?slaves=drive&name=stress&clock=virtual";

static unsigned next_random(unsigned *seed)
{
    *seed = *seed * 1664525u + 1013904223u;
    return *seed >> 16;
}

static void *worker(void *number)
{
    unsigned seed = *(unsigned *)number;
    unsigned char buffer[512 + 16];
    ecmsk_board *board = NULL;
    ecmsk_stats stats;
    ecmsk_counters counters;
    char name[64];
    int round;

    for (round = 0; round < ROUNDS; round++) {
        unsigned long length = 1 + next_random(&seed) % 600;
        memset(buffer, 0xA5, sizeof buffer);
        switch (next_random(&seed) % 16) {
        case 0:
            OpenECMUSB();
            break;
        case 1:
            CloseECMUSB();
            break;
        case 2:
            ecmsk_open(uri, &board);
            break;
        case 3:
            ecmsk_close(board);
            break;
        case 4:
            ecmsk_read(board, buffer, length, 1);
            break;
        case 5:
            memset(buffer, 0, sizeof buffer);
            ecmsk_write(board, buffer, length, 1);
            break;
        case 6:
            stats.size = sizeof stats;
            ecmsk_get_stats(next_random(&seed) % 2 ? board : ecmsk_vendor_board(), &stats);
            break;
        case 7:
            counters.size = sizeof counters;
            ecmsk_get_counters(next_random(&seed) % 2 ? board : ecmsk_vendor_board(), &counters);
            break;
        case 8:
            CHECK(strlen(ecmsk_last_error()) < 1000);
            ecmsk_get_link_name(ecmsk_vendor_board(), name, sizeof name, NULL);
            break;
        case 9:
        case 10:
        case 11:
            memset(buffer, 0, sizeof buffer);
            ECMUSBWrite(buffer, length);
            break;
        default:
            ECMUSBRead(buffer, length);
            if (length < 512) {
                CHECK(is_filled_with(buffer + length, sizeof buffer - length, 0xA5));
            }
            break;
        }
        if (buffer[512] != 0) {
            CHECK(is_filled_with(buffer + 512, 16, 0xA5));
        }
    }
    ecmsk_close(board);
    return NULL;
}

int main(void)
{
    pthread_t threads[THREADS];
    unsigned seeds[THREADS];
    int i;

    for (i = 0; i < THREADS; i++) {
        seeds[i] = (unsigned)i * 7919u + 1u;
        CHECK(pthread_create(&threads[i], NULL, worker, &seeds[i]) == 0);
    }
    for (i = 0; i < THREADS; i++) {
        CHECK(pthread_join(threads[i], NULL) == 0);
    }
    CHECK(OpenECMUSB());
    CHECK(read_response());
    CHECK(write_command());
    CloseECMUSB();
    puts("ok");
    return 0;
}
