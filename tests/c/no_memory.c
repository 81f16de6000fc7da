/* A system without memory. For each amount of it a child has so much left and no more; it opens, writes and reads, and ends by
 * itself, with or without a board. */
#define _DEFAULT_SOURCE
#include "check.h"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

/* The exit codes of a child: all went well, or a call has failed and said why. */
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

static int with_only(unsigned long more)
{
    struct rlimit limit;
    limit.rlim_cur = limit.rlim_max = bytes_in_use() + more;
    CHECK(setrlimit(RLIMIT_AS, &limit) == 0);
    if (!OpenECMUSB() || !write_command() || !read_response()) {
        return told();
    }
    CHECK(write_command() && read_response());
    CloseECMUSB();
    return WELL;
}

int main(void)
{
    int ended[4] = {0, 0, 0, 0}, status;
    unsigned long more;
    for (more = 0; more < MOST; more += more < 24 * 1024 * 1024 ? SMALL_STEP : LARGE_STEP) {
        pid_t child = fork();
        CHECK(child >= 0);
        if (child == 0) {
            _exit(with_only(more));
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
