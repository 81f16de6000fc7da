/* A program whose calls fail, each with a line in the log. Arguments: how many; then "fork": a child does the same
 * first. It prints `ok`, and ends with its standard input. */
#define _DEFAULT_SOURCE
#include "check.h"

#include <sys/wait.h>
#include <unistd.h>

static void fail(int times)
{
    int i;
    for (i = 0; i < times; i++) {
        CHECK(!read_response());
    }
}

int main(int count, char **arguments)
{
    int times = count > 1 ? atoi(arguments[1]) : 1;

    fail(times);
    if (count > 2 && strcmp(arguments[2], "fork") == 0) {
        int status;
        pid_t child = fork();
        CHECK(child >= 0);
        if (child == 0) {
            fail(times);
            return 0;
        }
        CHECK(waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0);
    }
    puts("ok");
    fflush(stdout);
    while (getchar() != EOF) {
    }
    return 0;
}
