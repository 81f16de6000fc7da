/* A user in so many groups that what the system says of a thread is longer than usual: a thread that is blocked in a read keeps
 * no other from sleeping. Only root may have such groups without being in them. */
#define _GNU_SOURCE
#include <grp.h>
#include <pthread.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>

#define GROUPS 2000

static int ends[2];

static void *read_for_ever(void *byte)
{
    return read(ends[0], byte, 1) == 1 ? byte : NULL;
}

int main(void)
{
    gid_t groups[GROUPS];
    pthread_t thread;
    char byte;
    int i;

    for (i = 0; i < GROUPS; i++) {
        groups[i] = 1000000 + i;
    }
    if (geteuid() == 0 && setgroups(GROUPS, groups) != 0) {
        perror("setgroups");
    }
    if (pipe(ends) != 0 || pthread_create(&thread, NULL, read_for_ever, &byte) != 0) {
        return 1;
    }
    /* On the real clock: ends the program if sleeps take as long. */
    alarm(60);
    for (i = 0; i < 1000; i++) {
        sleep(1);
    }
    puts("ok");
    return 0;
}
