/* A program that opens its board, then blocks SIGINT in its own thread to take it from a signalfd, as programs with
 * an event loop do: the signal must not end the program through a thread of the library. */
#define _GNU_SOURCE
#include "check.h"

#include <signal.h>
#include <sys/signalfd.h>
#include <unistd.h>

int main(void)
{
    struct signalfd_siginfo taken;
    sigset_t wanted;
    int from;

    CHECK(OpenECMUSB());
    CHECK(read_response());
    CHECK(sigemptyset(&wanted) == 0 && sigaddset(&wanted, SIGINT) == 0);
    CHECK(pthread_sigmask(SIG_BLOCK, &wanted, NULL) == 0);
    from = signalfd(-1, &wanted, 0);
    CHECK(from >= 0);
    CHECK(kill(getpid(), SIGINT) == 0);
    CHECK(read(from, &taken, sizeof taken) == (ssize_t)sizeof taken && taken.ssi_signo == SIGINT);
    CHECK(write_command() && read_response());
    CloseECMUSB();
    puts("ok");
    return 0;
}
