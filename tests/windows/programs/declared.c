/* The same in C; the result is one byte. */
unsigned char __stdcall OpenECMUSB(void);
void __stdcall CloseECMUSB(void);
unsigned char __stdcall ECMUSBWrite(unsigned char *data, unsigned long dwlength);
unsigned char __stdcall ECMUSBRead(unsigned char *data, unsigned long dwlength);

static unsigned char frame[512];

int start(void)
{
    int i;
    if (ECMUSBRead(frame, sizeof frame))
        return 1;
    if (!OpenECMUSB())
        return 2;
    for (i = 0; i < 100; i++) {
        if (!ECMUSBWrite(frame, sizeof frame))
            return 3;
        if (!ECMUSBRead(frame, sizeof frame))
            return 4;
    }
    CloseECMUSB();
    if (ECMUSBWrite(frame, sizeof frame))
        return 5;
    return 0;
}
