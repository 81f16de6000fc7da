/* A library that returns the last written frame. Its byte 2 selects the result of a read: 1 true, 0 false, 9 false
 * with the buffer unchanged. */
#include <string.h>

int OpenECMUSB(void);
void CloseECMUSB(void);
int ECMUSBWrite(unsigned char *data, unsigned long length);
int ECMUSBRead(unsigned char *data, unsigned long length);

static unsigned char frame[512];

int OpenECMUSB(void) { return 1; }
void CloseECMUSB(void) {}

int ECMUSBWrite(unsigned char *data, unsigned long length)
{
    /* A caller that declares 32 bits leaves the others undefined. */
    unsigned bytes = (unsigned)length;
    if (bytes != 504 && bytes != 512) {
        return 0;
    }
    memset(frame, 0xCC, sizeof frame);
    memcpy(frame, data, bytes);
    return 1;
}

int ECMUSBRead(unsigned char *data, unsigned long length)
{
    if ((unsigned)length != 612 || frame[2] == 9) {
        return 0;
    }
    memcpy(data, frame, sizeof frame);
    memset(data + sizeof frame, 0xEE, 612 - sizeof frame);
    return frame[2] == 1;
}
