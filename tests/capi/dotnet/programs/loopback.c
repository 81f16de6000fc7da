/* A library that gives back the frame which was written last. Its byte 2 says what a read answers: 1 true, 0 false, 9 false with
   the buffer left alone. */
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
    /* A caller who declares 32 bits says nothing of the others. */
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
