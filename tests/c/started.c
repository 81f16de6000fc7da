/* Under --clock virtual a program that this one starts sleeps for an hour, on its own clock: here no time passes. */
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

int main(void)
{
    time_t began;
    /* A sleep that begins with a second. */
    sleep(1);
    began = time(NULL);
    if (system("sleep 3600") != 0) {
        return 1;
    }
    printf("%ld s\n", (long)(time(NULL) - began));
    return 0;
}
