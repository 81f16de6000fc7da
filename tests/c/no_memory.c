/* A system without memory. For each amount there is a child with only that much left; it opens, writes and reads,
 * and ends by itself, with or without a board. With the argument `ecmsk_open` it uses the functions for several boards.
 * */
#define _DEFAULT_SOURCE
#include "check.h"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

/* The exit codes of a child: all calls succeeded, or a call has failed with a reason. */
enum { WELL = 0, TOLD = 3 };
enum { SMALL_STEP = 96 * 1024, LARGE_STEP = 2 * 1024 * 1024, MOST = 64 * 1024 * 1024 };

static unsigned long bytes_in_use(void)
{
    unsigned long pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    CHECK(file != NULL && fscanf(file, "%lu", &pages) == 1);
    fclose(file);
    return pages * (unsigned long)sysconf(_SC_PAGESIZE);
}

static int told(void)
{
    CHECK(last_error_has("memory") || last_error_has("thread"));
    return TOLD;
}

static void leave_only(unsigned long more)
{
    struct rlimit limit;
    limit.rlim_cur = limit.rlim_max = bytes_in_use() + more;
    CHECK(setrlimit(RLIMIT_AS, &limit) == 0);
}

static int opens_by_uri(void)
{
    /* A returned value must not be a false handle. */
    ecmsk_board *board = (ecmsk_board *)command;
    ecmsk_result result = ecmsk_open(getenv("ECMSK_LINK"), &board);
    if (result != ECMSK_OK) {
        CHECK(result == ECMSK_ERROR_IO && board == NULL);
        return told();
    }
    result = ecmsk_write(board, (unsigned char *)command, sizeof command, ECMSK_WAIT_LINK);
    if (result == ECMSK_OK) {
        result = ecmsk_read(board, (unsigned char *)response, sizeof response, ECMSK_WAIT_LINK);
    }
    if (result != ECMSK_OK) {
        CHECK(result == ECMSK_ERROR_IO);
        return told();
    }
    CHECK(ecmsk_close(board) == ECMSK_OK);
    return WELL;
}

static int opens(void)
{
    if (!OpenECMUSB() || !write_command() || !read_response()) {
        return told();
    }
    CHECK(write_command() && read_response());
    CloseECMUSB();
    return WELL;
}

int main(int count, char **arguments)
{
    bool by_uri = count > 1 && strcmp(arguments[1], "ecmsk_open") == 0;
    int ended[4] = {0, 0, 0, 0}, status;
    unsigned long more;
    for (more = 0; more < MOST; more += more < 24 * 1024 * 1024 ? SMALL_STEP : LARGE_STEP) {
        pid_t child = fork();
        CHECK(child >= 0);
        if (child == 0) {
            leave_only(more);
            _exit(by_uri ? opens_by_uri() : opens());
        }
        CHECK(waitpid(child, &status, 0) == child);
        if (!WIFEXITED(status)) {
            fprintf(stderr, "with %lu bytes: signal %d\n", more, WTERMSIG(status));
            return 1;
        }
        CHECK(WEXITSTATUS(status) == WELL || WEXITSTATUS(status) == TOLD);
        ended[WEXITSTATUS(status)]++;
    }
    CHECK(ended[WELL] > 0 && ended[TOLD] > 0);
    puts("ok");
    return 0;
}
