/*
 * NEXTWUSBLib, slots of 12 bytes: the four functions of the ECM-SK's USB library, a slot of its frames, and the numbers
 * that stand in it.
 *
 * C99, C++98 and later. This header is frozen: programs are compiled against it.
 * Numbers: ECM-SK User Guide V1.7.4, chapters 2 and 4.
 */
#ifndef NEXTWUSBLIB_12B_H
#define NEXTWUSBLIB_12B_H

#ifdef NEXTWUSBLIB_16B_H
#error "one of NEXTWUSBLib_12B.h and NEXTWUSBLib_16B.h, not both: they declare transData differently"
#endif

#ifndef __cplusplus
#include <stdbool.h>
#endif

/* Slots of a frame: the ECM, 40 slaves, one for SDOs. */
#define DEF_MA_MAX 42

/* State of the network: SET_STATE's Data1, byte 2 of a response. */
#define NIC_INIT 0
#define STATE_INIT 1
#define STATE_PRE_OP 2
#define STATE_SAFE_OP 4
#define STATE_OPERATIONAL 8

/* Commands: transData.CMD. */
#define GET_STATUS 0x00
#define SET_STATE 0x01
#define SET_AXIS 0x02
#define SET_DC 0x03
#define SET_EX 0x04
#define SET_FIFO 0x05
#define DRIVE_MODE 0x06
#define SDO_RD 0x07
#define SDO_WR 0x08
#define ALM_CLR 0x10
#define SV_ON 0x11
#define SV_OFF 0x12
#define IO_RD 0x13
#define IO_WR 0x14
#define CSP 0x15
#define CSV 0x16
#define CST 0x17
#define GO_HOME 0x18
#define ABORT_HOME 0x19
#define LIO_RD 0x21
#define LIO_WR 0x22
#define SW_RESET 0xBB

/* Mode of a drive: DRIVE_MODE's Data1. */
#define HOMING_MODE 6
#define CSP_MODE 8
#define CSV_MODE 9
#define CST_MODE 10

/* Synchronisation of a drive: DRIVE_MODE's Data2. */
#define FREERUN 0
#define DCSYNC 1

/* Kind of slave: one nibble each of SET_AXIS's Data1. */
#define DRIVE 0x0
#define IO 0x1
#define HSP 0x2
#define STEP 0x3
#define None 0xF

/* One slot of a command or a response. */
struct transData {
    unsigned short CMD;
    unsigned short Parm;
    unsigned int Data1;
    unsigned int Data2;
};
#ifndef __cplusplus
typedef struct transData transData;
#endif

#ifdef _WIN32
#define NEXTWUSB_CALL __stdcall
#else
#define NEXTWUSB_CALL
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Opens the board. True if it is open, also if it was already. */
bool NEXTWUSB_CALL OpenECMUSB(void);

/* Closes the board; waits in other threads end. Harmless when it is closed. */
void NEXTWUSB_CALL CloseECMUSB(void);

/* Writes a command frame of dwlength bytes, 504. True if the board took it. */
bool NEXTWUSB_CALL ECMUSBWrite(unsigned char *data, unsigned long dwlength);

/* Reads a response of dwlength bytes, 504; waits until there is one. After
 * False data holds the frame that was moved last: as a rule the program's own
 * command. */
bool NEXTWUSB_CALL ECMUSBRead(unsigned char *data, unsigned long dwlength);

#ifdef __cplusplus
}
#endif

#endif
