/* A firmware in C on libcontroller.a, on this machine: `ecmsk serve xf` has the chip in the place of SPI.
 *
 *     main PORT        prints how many slaves the chip has found
 *
 * On a microcontroller exchange() drives the SPI, and now() reads a timer. Messages of the server: docs/XF-PORT.md. */
#define _POSIX_C_SOURCE 200809L
#include "controller.h"

#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum { EXCHANGE = 1, LONGEST = 4096 };

static int server;

/* Whether all bytes were sent, and received. */
static bool sent(const uint8_t *bytes, size_t count)
{
    for (ssize_t done; count > 0; bytes += done, count -= (size_t)done)
        if ((done = write(server, bytes, count)) <= 0)
            return false;
    return true;
}
static bool received(uint8_t *bytes, size_t count)
{
    for (ssize_t done; count > 0; bytes += done, count -= (size_t)done)
        if ((done = read(server, bytes, count)) <= 0)
            return false;
    return true;
}

/* Receives an answer of `count` bytes. An error of the server has its text in it. */
static bool answered(uint8_t *bytes, size_t count)
{
    uint8_t head[4], text[LONGEST];
    size_t len;
    if (!received(head, sizeof head))
        return false;
    len = head[2] | (size_t)head[3] << 8;
    if (len > LONGEST || !received(text, len))
        return false;
    if (head[1] != 0)
        fprintf(stderr, "%.*s\n", (int)len, (const char *)text);
    if (head[1] != 0 || len != count)
        return false;
    memcpy(bytes, text, count);
    return true;
}

static int32_t exchange(const uint8_t *to_chip, uint8_t *from_chip, size_t len)
{
    uint8_t head[4] = {EXCHANGE, 0, (uint8_t)len, (uint8_t)(len >> 8)};
    return len <= LONGEST && sent(head, sizeof head) && sent(to_chip, len) && answered(from_chip, len) ? 0 : 1;
}

static uint64_t now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (uint64_t)time.tv_sec * 1000000000u + (uint64_t)time.tv_nsec;
}

static bool busy(void) { return false; }

int main(int argc, char **argv)
{
    static const struct controller_firmware firmware = {exchange, now, busy};
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons((uint16_t)atoi(argc > 1 ? argv[1] : "4712"))};
    uint8_t greeting[8];
    int32_t slaves;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    server = socket(AF_INET, SOCK_STREAM, 0);
    if (server < 0 || connect(server, (struct sockaddr *)&address, sizeof address) != 0)
        return perror("nobody serves a chip there"), 1;
    if (!answered(greeting, sizeof greeting) || memcmp(greeting, "ECMXF\1", 6) != 0)
        return fprintf(stderr, "this is no server for a chip, or of another version\n"), 1;
    slaves = controller_slaves(&firmware);
    if (slaves < 0)
        return fprintf(stderr, "the chip does not answer\n"), 1;
    printf("%d slaves\n", (int)slaves);
    return 0;
}
