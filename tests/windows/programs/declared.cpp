// A C++ program with declarations of its own, as in the vendor's headers: some copies inside extern "C" (-DEXTERN_C), some not. It needs
// no C library: its exit code is the failed step, or 0.
#ifdef EXTERN_C
extern "C" {
#endif
bool __stdcall OpenECMUSB(void);
void __stdcall CloseECMUSB(void);
bool __stdcall ECMUSBWrite(unsigned char *data, unsigned long dwlength);
bool __stdcall ECMUSBRead(unsigned char *data, unsigned long dwlength);
#ifdef EXTERN_C
}
#endif

static unsigned char frame[504];

extern "C" int start(void)
{
    if (ECMUSBRead(frame, sizeof frame))
        return 1;
    if (!OpenECMUSB())
        return 2;
    for (int i = 0; i < 100; i++) {
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
