/* A chip ECM-XF behind `ecmsk serve xf`: xf_exchange() stands in for SPI, so that a driver for the chip runs on the model.
 * The rest finds n, the bytes of data in a packet, and asks for the firmware's version. Messages: docs/XF-PORT.md. */
#define _POSIX_C_SOURCE 200809L
#include <arpa/inet.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum { EXCHANGE = 1, DELAY = 4, CLOSE = 5, LONGEST = 4096, FIXED = 25, VERSION = 56 };

static int server;

static void all(ssize_t (*move)(int, void *, size_t), void *bytes, size_t count)
{
    for (ssize_t done; count > 0; bytes = (uint8_t *)bytes + done, count -= (size_t)done)
        if ((done = move(server, bytes, count)) <= 0)
            exit((perror("the server is gone"), 1));
}
static ssize_t put(int to, void *bytes, size_t count) { return write(to, bytes, count); }

/* Sends a request and gets its answer; with kind 0 the greeting is the answer. */
static size_t ask(int kind, const void *body, size_t count, uint8_t *answer)
{
    uint8_t message[4 + LONGEST] = {(uint8_t)kind, 0, (uint8_t)count, (uint8_t)(count >> 8)};
    if (count > 0)
        memcpy(message + 4, body, count);
    if (kind != 0)
        all(put, message, 4 + count);
    all(read, message, 4);
    count = message[2] | (size_t)message[3] << 8;
    all(read, answer, count);
    if (message[1] != 0)
        exit((fprintf(stderr, "%.*s\n", (int)count, (char *)answer), 1));
    return count;
}

/* What a driver calls in the place of SPI: both ways at once, under one chip select. */
static void xf_exchange(const uint8_t *to, uint8_t *from, size_t count) { ask(EXCHANGE, to, count, from); }
static void xf_delay_us(uint32_t us)
{
    uint8_t body[4] = {(uint8_t)us, (uint8_t)(us >> 8), (uint8_t)(us >> 16), (uint8_t)(us >> 24)}, none[LONGEST];
    ask(DELAY, body, sizeof body, none);
}

/* Sends a command with the fixed check word until its answer is there, which comes in a later exchange. */
static void command(uint8_t index, uint8_t code, size_t n, uint8_t *answer)
{
    uint8_t packet[LONGEST] = {0xA4, 0xA3, 0xA2, 0xA1, 0, 0, 0, 0, 0, 0, 0xF8, index, code};
    memcpy(packet + 24 + n, "\x78\x56\x34\x12\x59\x58\x57\x56", 8);
    for (int tries = 0; tries < 1000; tries++, xf_delay_us(1000)) {
        xf_exchange(packet, answer, n + 32);
        if (answer[0x0B] == index && answer[0x0C] == code && !(answer[0x0A] & 0x20))
            return;
    }
    exit((fprintf(stderr, "no answer to command %d\n", code), 1));
}

int main(int argc, char **argv)
{
    static const uint8_t nothing[LONGEST], border[8] = {0x59, 0x58, 0x57, 0x56, 0xA4, 0xA3, 0xA2, 0xA1};
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons((uint16_t)atoi(argc > 1 ? argv[1] : "4712"))};
    uint8_t bytes[LONGEST];
    size_t n = 0, begin = 0;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    server = socket(AF_INET, SOCK_STREAM, 0);
    if (connect(server, (struct sockaddr *)&address, sizeof address) != 0)
        return perror("nobody serves a chip there"), 1;
    if (ask(0, NULL, 0, bytes) < 8 || memcmp(bytes, "ECMXF\1", 6) != 0)
        return fprintf(stderr, "this is no server for a chip, or of another version\n"), 1;

    xf_delay_us(1000000); /* what a chip takes to start */
    xf_exchange(nothing, bytes, LONGEST);
    for (size_t at = 0; at + 8 <= LONGEST; at++) /* a packet ends and the next one begins */
        if (memcmp(bytes + at, border, 8) == 0) {
            n = begin ? at + 4 - begin - 32 : 0;
            begin = at + 4;
        }
    if (n == 0)
        return fprintf(stderr, "no packets of a chip\n"), 1;
    xf_exchange(nothing, bytes, n + 32 - (LONGEST - begin)); /* the rest of the packet that has begun */
    command(1, FIXED, n, bytes); /* fixed check words from here on */
    command(2, VERSION, n, bytes);
    printf("n %u, firmware 0x%02X\n", (unsigned)n, bytes[0x0D]);
    ask(CLOSE, NULL, 0, bytes);
    return 0;
}
