/* Shared by the C programs of the tests. */
#ifndef CHECK_H
#define CHECK_H

#include "NEXTWUSBLib_12B.h"
#include "ecmsk.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Ends the program with a message if `holds` is false. */
#define CHECK(holds)                                                                                       \
    do {                                                                                                   \
        if (!(holds)) {                                                                                    \
            fprintf(stderr, "%s:%d: %s; last error: %s\n", __FILE__, __LINE__, #holds, ecmsk_last_error()); \
            exit(1);                                                                                       \
        }                                                                                                  \
    } while (0)

/* Frames as in programs. */
static transData command[DEF_MA_MAX];
static transData response[DEF_MA_MAX];

static inline bool write_command(void) { return ECMUSBWrite((unsigned char *)command, sizeof command); }

static inline bool read_response(void) { return ECMUSBRead((unsigned char *)response, sizeof response); }

static inline unsigned state(void) { return response[0].Parm & 0xFF; }

/* Writes a command for the board itself. */
static inline bool master(unsigned short id, unsigned short parm, unsigned data1, unsigned data2)
{
    memset(command, 0, sizeof command);
    command[0].CMD = id;
    command[0].Parm = parm;
    command[0].Data1 = data1;
    command[0].Data2 = data2;
    return write_command();
}

/* Declares every slave as a drive. Before SET_STATE: by default all are IO, and a drive does not go to SafeOP as IO. */
static inline void declare_drives(void) { CHECK(master(SET_AXIS, 0, 0, 0)); }

/* Requests a state and reads until the board has reached it. */
static inline void go_to(unsigned wanted)
{
    int reads;
    CHECK(master(SET_STATE, 0, wanted, 0));
    for (reads = 0; reads < 20000; reads++) {
        CHECK(read_response());
        if (state() == wanted) {
            return;
        }
    }
    fprintf(stderr, "state %u instead of %u\n", state(), wanted);
    exit(1);
}

static inline bool is_filled_with(const void *bytes, size_t length, unsigned char with)
{
    const unsigned char *at = (const unsigned char *)bytes;
    size_t i;
    for (i = 0; i < length; i++) {
        if (at[i] != with) {
            return false;
        }
    }
    return true;
}

static inline bool last_error_has(const char *part) { return strstr(ecmsk_last_error(), part) != NULL; }

#endif
