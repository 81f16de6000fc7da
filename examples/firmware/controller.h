/* What a firmware in C calls of libcontroller.a, and what it has to bring: three functions of its board support. */
#ifndef CONTROLLER_H
#define CONTROLLER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The bytes of a frame of a board with slots of 12 bytes; 504 of them pass over SPI. */
#define CONTROLLER_FRAME 512
/* The bytes of a screen for controller_show(). */
#define CONTROLLER_SCREEN 160

/* The functions of the board support. They are called from the calls below alone, in the same thread. */
struct controller_firmware {
    /* Exchanges `len` bytes on SPI under one chip select, mode 0. 0: it went well. */
    int32_t (*exchange)(const uint8_t *to_chip, uint8_t *from_chip, size_t len);
    /* The time in nanoseconds from any zero. It never goes back. */
    uint64_t (*now)(void);
    /* The level of BUSY of a board; not called for a chip. */
    bool (*busy)(void);
};

/* Fills `frame` with the commands of one cycle: slave 1 moves to `target`, in counts. `index`: 1 to 255, another one than in the
 * cycle before. */
void controller_command(uint8_t frame[CONTROLLER_FRAME], int32_t target, uint8_t index);

/* Reads the position of slave 1, in counts, out of the answer in `frame`. 0, or why there is none: 1 its CRC is wrong, 2 the
 * board is not in OP, 3 the drive is not in Operation enabled, 4 the answer is to another command. */
int32_t controller_response(const uint8_t frame[CONTROLLER_FRAME], int32_t *position);

/* Writes `frame` as text, without a 0 at its end, as far as it fits; returns the number of bytes. */
size_t controller_show(const uint8_t frame[CONTROLLER_FRAME], uint8_t screen[CONTROLLER_SCREEN]);

/* The state byte of the board on SPI: 1 Init, 2 PreOP, 4 SafeOP, 8 OP. -1: it is busy or does not answer. The call sends a frame
 * without commands, which takes an entry of the FIFO in OP. */
int32_t controller_state(const struct controller_firmware *firmware);

/* Starts the chip ECM-XF on SPI and its network; returns the number of slaves. -1: the chip does not answer, or refuses. The call
 * returns after some seconds; without an answer after 10 s for the start and 30 s for each of two commands. */
int32_t controller_slaves(const struct controller_firmware *firmware);

#ifdef __cplusplus
}
#endif

#endif
