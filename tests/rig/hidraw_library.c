/* The four functions of NEXTWUSBLib on a hidraw node, used as by the vendor's library: 513 bytes out, the first of
   them the report id 0, 512 in. Only for the wire tests.

   RIG_NODE names the node; every frame that was written is appended to the file RIG_SENT. */
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { FRAME = 512 };

static int board = -1;
static FILE *sent;

bool OpenECMUSB(void)
{
    const char *node = getenv("RIG_NODE"), *file = getenv("RIG_SENT");
    if (board < 0 && node != NULL && file != NULL) {
        board = open(node, O_RDWR);
        sent = fopen(file, "wb");
    }
    return board >= 0 && sent != NULL;
}

void CloseECMUSB(void)
{
    if (board >= 0) {
        close(board);
        fclose(sent);
    }
    board = -1;
}

bool ECMUSBWrite(unsigned char *data, unsigned long length)
{
    unsigned char report[1 + FRAME] = {0};
    if (board < 0 || data == NULL || length == 0)
        return false;
    memcpy(report + 1, data, length < FRAME ? length : FRAME);
    if (write(board, report, sizeof(report)) != (ssize_t)sizeof(report))
        return false;
    return fwrite(report + 1, FRAME, 1, sent) == 1;
}

bool ECMUSBRead(unsigned char *data, unsigned long length)
{
    unsigned char report[FRAME];
    if (board < 0 || data == NULL || length == 0 || read(board, report, sizeof(report)) != FRAME)
        return false;
    memcpy(data, report, length < FRAME ? length : FRAME);
    return true;
}
