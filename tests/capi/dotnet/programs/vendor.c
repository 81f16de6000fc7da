/* A library like the vendor's: only four functions, bool in the lowest byte of the register and any values in the
 * others. */
unsigned OpenECMUSB(void);
void CloseECMUSB(void);
unsigned ECMUSBWrite(unsigned char *data, unsigned long length);
unsigned ECMUSBRead(unsigned char *data, unsigned long length);

unsigned OpenECMUSB(void) { return 0xABCDEF01; }
void CloseECMUSB(void) {}

unsigned ECMUSBWrite(unsigned char *data, unsigned long length)
{
    return data != 0 && length == 504 ? 0xFFFFFF01 : 0;
}

unsigned ECMUSBRead(unsigned char *data, unsigned long length)
{
    (void)data;
    (void)length;
    return 0xFFFFFF00;
}
