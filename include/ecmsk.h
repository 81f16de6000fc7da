/*
 * ecmsk: what the library has beside the vendor's four functions, for programs that want to know why a call failed, to
 * open several boards at once, or to look at counters. It may be included together with a vendor header.
 *
 * Made by cbindgen from capi/src; do not edit.
 */

#ifndef ECMSK_H
#define ECMSK_H

#include <stddef.h>
#include <stdint.h>

/**
 * Done.
 */
#define ECMSK_OK 0

/**
 * An argument is NULL, of length 0, or not what the function takes; a URI that is wrong.
 */
#define ECMSK_ERROR_ARGUMENT -1

/**
 * The handle is of no open board.
 */
#define ECMSK_ERROR_HANDLE -2

/**
 * The limit of the wait has passed.
 */
#define ECMSK_ERROR_TIMEOUT -3

/**
 * On a virtual clock: no report will come by waiting.
 */
#define ECMSK_ERROR_SILENT -4

/**
 * The board is gone: close it and open it again.
 */
#define ECMSK_ERROR_LOST -5

/**
 * The board was closed, by this or another thread, or never opened.
 */
#define ECMSK_ERROR_CLOSED -6

/**
 * No board answers.
 */
#define ECMSK_ERROR_NO_BOARD -7

/**
 * Somebody else has the board.
 */
#define ECMSK_ERROR_IN_USE -8

/**
 * This build, or this link, cannot do that.
 */
#define ECMSK_ERROR_UNSUPPORTED -9

/**
 * The operating system said no.
 */
#define ECMSK_ERROR_IO -10

/**
 * A defect of this library.
 */
#define ECMSK_ERROR_INTERNAL -11

/**
 * A timeout: wait until it is done, the board is lost or closed.
 */
#define ECMSK_WAIT_FOREVER -1

/**
 * A timeout: as the link says, by `read_timeout_ms` and `write_timeout_ms`.
 */
#define ECMSK_WAIT_LINK -2

/**
 * Room for kinds of rejection: more than there are, so that a later version can count more.
 */
#define ECMSK_REJECT_KINDS 16

/**
 * An open board. Never followed as a pointer: a handle that was closed or made up gives `ECMSK_ERROR_HANDLE`.
 */
typedef struct ecmsk_board ecmsk_board;

/**
 * How a call ended: `ECMSK_OK`, or a negative number, and then `ecmsk_last_error` says why in words.
 */
typedef int32_t ecmsk_result;

/**
 * Faults that a link injected in one direction (`fault.` keys), since it was opened.
 */
typedef struct {
  /**
   * Frames lost on the way.
   */
  uint64_t dropped;
  /**
   * Frames with a bit turned over.
   */
  uint64_t corrupted;
  /**
   * Frames that arrived twice.
   */
  uint64_t duplicated;
  /**
   * Frames that were held up.
   */
  uint64_t delayed;
} ecmsk_faults;

/**
 * What a link moved since it was opened. Set `size` to sizeof of the structure before the call; afterwards it is the
 * number of bytes filled in.
 */
typedef struct {
  /**
   * Bytes of this structure.
   */
  uint32_t size;
  /**
   * 0.
   */
  uint32_t reserved;
  /**
   * Frames written.
   */
  uint64_t written;
  /**
   * Reports handed out.
   */
  uint64_t read;
  /**
   * Reports dropped because nobody read them; the oldest goes first.
   */
  uint64_t reports_dropped;
  /**
   * Writes that ended with an error.
   */
  uint64_t write_errors;
  /**
   * Reads that ended with an error.
   */
  uint64_t read_errors;
  /**
   * Frames that a recording could not take.
   */
  uint64_t record_dropped;
  /**
   * Faults injected into command frames.
   */
  ecmsk_faults write_faults;
  /**
   * Faults injected into reports.
   */
  ecmsk_faults read_faults;
  /**
   * 1: a fault took the board away; else 0.
   */
  uint64_t disconnected;
} ecmsk_stats;

/**
 * What happened to commands on the board since it booted. `size` as in `ecmsk_stats`.
 */
typedef struct {
  /**
   * Bytes of this structure.
   */
  uint32_t size;
  /**
   * 0.
   */
  uint32_t reserved;
  /**
   * Command frames that arrived.
   */
  uint64_t frames;
  /**
   * Reports made.
   */
  uint64_t reports;
  /**
   * Commands rejected, by reason; `ecmsk_reject_name` names the reasons.
   */
  uint64_t rejected[ECMSK_REJECT_KINDS];
  /**
   * Commands that came for a slave while it was homing.
   */
  uint64_t ignored_homing;
  /**
   * Targets that came before Operation enabled.
   */
  uint64_t discarded_before_enabled;
  /**
   * FIFO entries dropped by SET_FIFO 1 or by leaving OP.
   */
  uint64_t cleared;
  /**
   * Frames that found the FIFO full.
   */
  uint64_t full;
  /**
   * Frames with a wrong CRC.
   */
  uint64_t crc;
  /**
   * Frames that did not arrive completely.
   */
  uint64_t incomplete;
  /**
   * FIFO entries executed.
   */
  uint64_t executed;
  /**
   * Cycles in OP that took no entry: the FIFO was empty, or waited for its threshold.
   */
  uint64_t idle_cycles;
  /**
   * Command frames that arrived while the board booted; not among `frames`.
   */
  uint64_t while_booting;
  /**
   * Commands for slaves that were lost.
   */
  uint64_t for_lost;
  /**
   * Times the mode after homing could not be written back: the drive has stayed in mode 6.
   */
  uint64_t modes_not_restored;
} ecmsk_counters;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Opens the board of a link such as `sim:?slaves=drive*2` or `usb:` and puts its handle into `*board` (NULL if it
 * fails). A simulated board is shared by its `name=` only; one that is open already gives `ECMSK_ERROR_IN_USE`.
 *
 * # Safety
 * `uri` is NULL or a text that ends with 0. `board` is NULL or points to room for a pointer.
 */
ecmsk_result ecmsk_open(const char *uri, ecmsk_board **board);

/**
 * Closes a board. Calls under way in other threads end with `ECMSK_ERROR_CLOSED`; the handle is of no use afterwards.
 *
 * # Safety
 * None: any value may be passed.
 */
ecmsk_result ecmsk_close(ecmsk_board *board);

/**
 * The board of `OpenECMUSB` as a handle for the functions below. Always the same value; while that board is not open
 * they give `ECMSK_ERROR_CLOSED`.
 *
 * # Safety
 * None.
 */
ecmsk_board *ecmsk_vendor_board(void);

/**
 * Writes a command frame of `length` bytes: of more than 512 the first 512, fewer are filled up with 0.
 * `timeout_ms`: 0 does not wait, else that many milliseconds, `ECMSK_WAIT_FOREVER` or `ECMSK_WAIT_LINK`.
 *
 * # Safety
 * `data` is NULL or points to `length` readable bytes (512 if it is more). `board` may be any value.
 */
ecmsk_result ecmsk_write(ecmsk_board *board, const unsigned char *data, size_t length, int64_t timeout_ms);

/**
 * Waits for a report and copies its first `length` bytes (at most 512) to `data`, which is left as it was if there is
 * none. `timeout_ms` as for `ecmsk_write`.
 *
 * # Safety
 * `data` is NULL or points to `length` writable bytes (512 if it is more). `board` may be any value.
 */
ecmsk_result ecmsk_read(ecmsk_board *board, unsigned char *data, size_t length, int64_t timeout_ms);

/**
 * The version of this library, as `0.1.0`.
 *
 * # Safety
 * None. The text lives as long as the library.
 */
const char *ecmsk_version(void);

/**
 * Why the last call of this thread that failed did so, in words, those of the vendor's functions included; if none
 * failed in this thread, why OpenECMUSB failed last in any; else an empty text. A call that succeeds changes nothing.
 *
 * # Safety
 * None. The text is at one address for as long as the thread lives, at most 2047 bytes; the next call of this thread
 * that fails writes its own text there.
 */
const char *ecmsk_last_error(void);

/**
 * Statistics of the link since it was opened.
 *
 * # Safety
 * `stats` is NULL or points to `stats->size` writable bytes. `board` may be any value.
 */
ecmsk_result ecmsk_get_stats(ecmsk_board *board, ecmsk_stats *stats);

/**
 * The board's own counters since it booted. A link that does not see them, such as `usb:`, gives
 * `ECMSK_ERROR_UNSUPPORTED`.
 *
 * # Safety
 * `counters` is NULL or points to `counters->size` writable bytes. `board` may be any value.
 */
ecmsk_result ecmsk_get_counters(ecmsk_board *board, ecmsk_counters *counters);

/**
 * The name of a reason for rejection, an index into `rejected` of `ecmsk_counters`, or NULL if there is none.
 *
 * # Safety
 * None. The text lives as long as the library.
 */
const char *ecmsk_reject_name(uint32_t kind);

/**
 * Copies the link's URI in its normal form to `buffer`, at most `length` bytes, the last of them 0; a longer one is cut.
 * The bytes that it needs whole, the 0 included, go to `*needed` if that is not NULL.
 *
 * # Safety
 * `buffer` is NULL (then `length` must be 0) or points to `length` writable bytes. `needed` is NULL or points to room
 * for a `size_t`. `board` may be any value.
 */
ecmsk_result ecmsk_get_link_name(ecmsk_board *board,
                                 char *buffer,
                                 size_t length,
                                 size_t *needed);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ECMSK_H */
