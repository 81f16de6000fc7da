/*
 * ecmsk: functions of the library beside the vendor's four, for programs that need error texts, several open boards at
 * once, counters, or a machine file. This header may be included together with a vendor header.
 *
 * Made by cbindgen from capi/src; do not edit.
 */

#ifndef ECMSK_H
#define ECMSK_H

#include <stddef.h>
#include <stdint.h>

/**
 * The call has succeeded.
 */
#define ECMSK_OK 0

/**
 * An argument is NULL, has the length 0 or an invalid value, or the URI or the machine file is invalid.
 */
#define ECMSK_ERROR_ARGUMENT -1

/**
 * No open board has this handle, or no open machine file.
 */
#define ECMSK_ERROR_HANDLE -2

/**
 * The call has reached its timeout.
 */
#define ECMSK_ERROR_TIMEOUT -3

/**
 * The link has virtual time, which advances only inside calls, and the board sends no reports, for example because the cable
 * to its first slave is unplugged. No report would come however long the call waits. Connect the first slave again, then read
 * again.
 */
#define ECMSK_ERROR_SILENT -4

/**
 * The board was unplugged or does not answer any more. Close it and open it again.
 */
#define ECMSK_ERROR_LOST -5

/**
 * The board is not open, or was closed during the call.
 */
#define ECMSK_ERROR_CLOSED -6

/**
 * There is no board that the link could open.
 */
#define ECMSK_ERROR_NO_BOARD -7

/**
 * Another program uses the board.
 */
#define ECMSK_ERROR_IN_USE -8

/**
 * This build of the library, or this link, does not support the call.
 */
#define ECMSK_ERROR_UNSUPPORTED -9

/**
 * A call of the operating system has failed, or it has no memory left.
 */
#define ECMSK_ERROR_IO -10

/**
 * A defect of this library.
 */
#define ECMSK_ERROR_INTERNAL -11

/**
 * As a timeout: wait until the call is done or the board is lost or closed.
 */
#define ECMSK_WAIT_FOREVER -1

/**
 * As a timeout: the timeout of the link's URI, `read_timeout_ms` or `write_timeout_ms`.
 */
#define ECMSK_WAIT_LINK -2

/**
 * The number of entries of `rejected` in `ecmsk_counters`. There are fewer reasons, so that a later version can add some.
 */
#define ECMSK_REJECT_KINDS 16

/**
 * A handle of an open board. It is not an address: a handle that was closed or made up gives `ECMSK_ERROR_HANDLE`.
 */
typedef struct ecmsk_board ecmsk_board;

/**
 * A handle of an open machine file. It is not an address: a handle that was closed or made up gives `ECMSK_ERROR_HANDLE`.
 */
typedef struct ecmsk_machine ecmsk_machine;

/**
 * The result of a call: `ECMSK_OK`, or a negative error code. `ecmsk_last_error` has a text for every error.
 */
typedef int32_t ecmsk_result;

/**
 * The faults that a link has injected in one direction since it was opened (keys `fault.` of its URI).
 */
typedef struct {
  /**
   * Frames that were dropped.
   */
  uint64_t dropped;
  /**
   * Frames in which a bit was inverted.
   */
  uint64_t corrupted;
  /**
   * Frames that were delivered twice.
   */
  uint64_t duplicated;
  /**
   * Frames that were delayed.
   */
  uint64_t delayed;
} ecmsk_faults;

/**
 * The statistics of a link since it was opened. Set `size` to the sizeof of the structure before the call. After the call,
 * `size` is the number of bytes that were filled in.
 */
typedef struct {
  /**
   * The size of this structure in bytes.
   */
  uint32_t size;
  /**
   * Always 0. It aligns the counters to 8 bytes.
   */
  uint32_t reserved;
  /**
   * Command frames written.
   */
  uint64_t written;
  /**
   * Reports read.
   */
  uint64_t read;
  /**
   * Reports dropped because nobody read them in time. The oldest is dropped first.
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
   * Frames missing in a recording because it could not be written fast enough.
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
   * 1 if an injected fault has disconnected the board, otherwise 0.
   */
  uint64_t disconnected;
} ecmsk_stats;

/**
 * The counters of the board since it booted. `size` is used as in `ecmsk_stats`.
 */
typedef struct {
  /**
   * The size of this structure in bytes.
   */
  uint32_t size;
  /**
   * Always 0. It aligns the counters to 8 bytes.
   */
  uint32_t reserved;
  /**
   * Command frames received.
   */
  uint64_t frames;
  /**
   * Reports sent.
   */
  uint64_t reports;
  /**
   * Commands rejected, by reason. `ecmsk_reject_name` names the reason of an index.
   */
  uint64_t rejected[ECMSK_REJECT_KINDS];
  /**
   * Commands for a slave that were ignored because it was homing.
   */
  uint64_t ignored_homing;
  /**
   * Targets discarded because the drive was not in Operation enabled yet.
   */
  uint64_t discarded_before_enabled;
  /**
   * FIFO entries dropped by SET_FIFO 1 or by leaving OP.
   */
  uint64_t cleared;
  /**
   * Command frames lost because the FIFO was full.
   */
  uint64_t full;
  /**
   * Command frames refused because of a wrong CRC.
   */
  uint64_t crc;
  /**
   * Command frames of which only a part was received.
   */
  uint64_t incomplete;
  /**
   * FIFO entries executed.
   */
  uint64_t executed;
  /**
   * Cycles in OP that executed no entry: the FIFO was empty, or below its threshold.
   */
  uint64_t idle_cycles;
  /**
   * Command frames lost because the board was booting; not counted in `frames`.
   */
  uint64_t while_booting;
  /**
   * Commands for slaves that had left the network.
   */
  uint64_t for_lost;
  /**
   * How often the mode of operation could not be written back after homing, so that the drive stays in mode 6.
   */
  uint64_t modes_not_restored;
  /**
   * SDO requests that repeat the one under way; nothing is lost by them.
   */
  uint64_t sdo_repeated;
  /**
   * SDO transfers that the slave has aborted, or that were not answered in time.
   */
  uint64_t sdo_aborted;
  /**
   * Cycles without a report because a chip or a network card lost their answers.
   */
  uint64_t answers_lost;
  /**
   * FIFO entries that a chip or a network card had accepted and that a slave has missed, or may have missed.
   */
  uint64_t outputs_lost;
  /**
   * Cycles that were skipped on a network card because the machine was too late for them. Moving axes stood still meanwhile.
   */
  uint64_t cycles_left_out;
  /**
   * Cycles in OP in which the ring of cables between two network cards was broken. No data are lost by that.
   */
  uint64_t ring_broken;
  /**
   * Cycles in OP in which a slave kept its previous inputs because the working counter of the new ones was wrong.
   */
  uint64_t inputs_held;
  /**
   * How often the inputs of a slave were missing for so long that the slave counts as lost.
   */
  uint64_t inputs_stale;
} ecmsk_counters;

/**
 * An axis of a machine file. `size` is used as in `ecmsk_stats`. The limits can be compared as they are: one that the file
 * does not give is infinite, or the end of the 32 bits of a position.
 */
typedef struct {
  /**
   * The size of this structure in bytes.
   */
  uint32_t size;
  /**
   * The number of the slave that moves the axis, 1 to 40. It is the number of the axis and of the slot of its commands, too.
   */
  uint32_t slave;
  /**
   * The number of counts in one unit; not 0. It is negative if the unit counts in the opposite direction.
   */
  double counts_per_unit;
  /**
   * The lowest position that a target may have, in units: the nearest count. Without a limit it is -INFINITY.
   */
  double min_units;
  /**
   * The highest position that a target may have, in units: the nearest count. Without a limit it is INFINITY.
   */
  double max_units;
  /**
   * The highest speed of a move, in units per second. Without a limit it is INFINITY.
   */
  double max_velocity;
  /**
   * The highest acceleration of a move, in units per second squared. Without a limit it is INFINITY.
   */
  double max_acceleration;
  /**
   * The lowest target in counts. Without a limit it is INT32_MIN. It is the end `max_units` if `counts_per_unit` is negative.
   */
  int32_t min_counts;
  /**
   * The highest target in counts. Without a limit it is INT32_MAX. It is the end `min_units` if `counts_per_unit` is negative.
   */
  int32_t max_counts;
} ecmsk_axis;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Opens the board that a link's URI names, such as `sim:?slaves=drive*2` or `usb:`. Writes the handle of the board to
 * `*board`, or NULL if the call fails. Two links to simulated boards lead to the same board only if they have the same
 * `name=`. A board that is open already gives `ECMSK_ERROR_IN_USE`.
 *
 * # Safety
 * `uri` is NULL or a text that ends with 0. `board` is NULL or points to room for a pointer.
 */
ecmsk_result ecmsk_open(const char *uri, ecmsk_board **board);

/**
 * Closes a board. Calls under way in other threads end with `ECMSK_ERROR_CLOSED`. The handle is invalid afterwards.
 *
 * # Safety
 * None: any value may be passed.
 */
ecmsk_result ecmsk_close(ecmsk_board *board);

/**
 * A handle of the board of `OpenECMUSB`, for the functions below. It always has the same value. While that board is not
 * open, the functions return `ECMSK_ERROR_CLOSED`.
 *
 * # Safety
 * None.
 */
ecmsk_board *ecmsk_vendor_board(void);

/**
 * Writes a command frame of `length` bytes. If `length` is over 512, only the first 512 bytes are written; a shorter frame is
 * filled up with 0. `timeout_ms` is the longest wait in milliseconds, `ECMSK_WAIT_FOREVER` or `ECMSK_WAIT_LINK`; with 0 the
 * call does not wait.
 *
 * # Safety
 * `data` is NULL or points to `length` readable bytes (512 if it is more). `board` may be any value.
 */
ecmsk_result ecmsk_write(ecmsk_board *board,
                         const unsigned char *data,
                         size_t length,
                         int64_t timeout_ms);

/**
 * Waits for a report and copies its first `length` bytes, at most 512, to `data`, which is unchanged if the call fails.
 * `timeout_ms` is used as in `ecmsk_write`.
 *
 * # Safety
 * `data` is NULL or points to `length` writable bytes (512 if it is more). `board` may be any value.
 */
ecmsk_result ecmsk_read(ecmsk_board *board, unsigned char *data, size_t length, int64_t timeout_ms);

/**
 * The version of this library, such as `0.1.0`.
 *
 * # Safety
 * None. The text lives as long as the library.
 */
const char *ecmsk_version(void);

/**
 * The error text of the last call of this thread that failed, including calls of the vendor's functions. If no call of this
 * thread has failed, it is the text of the last OpenECMUSB that failed in any thread. If none has failed, it is an empty
 * text. A call that succeeds does not change the text.
 *
 * # Safety
 * None. The text has at most 2047 bytes and stays at the same address as long as the thread lives; the next call of this
 * thread that fails overwrites it.
 */
const char *ecmsk_last_error(void);

/**
 * Gets the statistics of a board's link since it was opened.
 *
 * # Safety
 * `stats` is NULL or points to `stats->size` writable bytes. `board` may be any value.
 */
ecmsk_result ecmsk_get_stats(ecmsk_board *board, ecmsk_stats *stats);

/**
 * Gets the counters of the board since it booted. Only the modelled board has them; on other links, such as `usb:`, the
 * result is `ECMSK_ERROR_UNSUPPORTED`.
 *
 * # Safety
 * `counters` is NULL or points to `counters->size` writable bytes. `board` may be any value.
 */
ecmsk_result ecmsk_get_counters(ecmsk_board *board, ecmsk_counters *counters);

/**
 * The name of the reason with index `kind` in `rejected` of `ecmsk_counters`; NULL if there is no such reason.
 *
 * # Safety
 * None. The text lives as long as the library.
 */
const char *ecmsk_reject_name(uint32_t kind);

/**
 * Copies the URI of a board's link, in its normal form and with a terminating 0, to the `length` bytes at `buffer`; a longer
 * URI is cut. The number of bytes that the whole URI needs, including the 0, is written to `*needed` unless `needed` is NULL.
 *
 * # Safety
 * `buffer` is NULL (then `length` must be 0) or points to `length` writable bytes. `needed` is NULL or points to room
 * for a `size_t`. `board` may be any value.
 */
ecmsk_result ecmsk_get_link_name(ecmsk_board *board,
                                 char *buffer,
                                 size_t length,
                                 size_t *needed);

/**
 * Reads the machine file at the path `file`, such as `machine.toml`, and checks all of it. Writes its handle to `*machine`,
 * or NULL if the call fails. The result is `ECMSK_ERROR_IO` if the file cannot be read, and `ECMSK_ERROR_ARGUMENT` if it is
 * wrong; the error text then has the line, the field and what to do. The file is read in this call alone, and no board is
 * opened.
 *
 * # Safety
 * `file` is NULL or a text in UTF-8 that ends with 0. `machine` is NULL or points to room for a pointer.
 */
ecmsk_result ecmsk_machine_open(const char *file,
                                ecmsk_machine **machine);

/**
 * Closes a machine file. The handle is invalid afterwards. A board that was opened with its link stays open.
 *
 * # Safety
 * None: any value may be passed.
 */
ecmsk_result ecmsk_machine_close(ecmsk_machine *machine);

/**
 * Copies the URI of the machine's board, for `ecmsk_open`, to the `length` bytes at `buffer`, as `ecmsk_get_link_name` does.
 * It is the link of the environment variable `ECMSK_LINK`, which `ecmsk exec` sets, otherwise that of the file. With the key
 * `axes=` a target beyond the soft limits is reported in the log, and not sent if the file says so. A simulated board has
 * the slaves of the file. If neither names a link the text is empty. If `ECMSK_LINK` is no URI of a link the result is
 * `ECMSK_ERROR_ARGUMENT`.
 *
 * # Safety
 * As for `ecmsk_get_link_name`. `machine` may be any value.
 */
ecmsk_result ecmsk_machine_get_link(ecmsk_machine *machine,
                                    char *buffer,
                                    size_t length,
                                    size_t *needed);

/**
 * Writes the number of axes to `*count`. Their indexes are 0 to the number minus 1, in the order of their slaves.
 *
 * # Safety
 * `count` is NULL or points to room for a `uint32_t`. `machine` may be any value.
 */
ecmsk_result ecmsk_machine_get_axis_count(ecmsk_machine *machine, uint32_t *count);

/**
 * Writes the index of the axis with this name to `*index`. Upper and lower case are the same. Without such an axis the
 * result is `ECMSK_ERROR_ARGUMENT`.
 *
 * # Safety
 * `name` is NULL or a text in UTF-8 that ends with 0. `index` is NULL or points to room for a `uint32_t`. `machine` may be
 * any value.
 */
ecmsk_result ecmsk_machine_find_axis(ecmsk_machine *machine,
                                     const char *name,
                                     uint32_t *index);

/**
 * Gets the axis with this index. Its name and its unit are `ecmsk_machine_get_axis_name` and `ecmsk_machine_get_axis_unit`.
 *
 * # Safety
 * `axis` is NULL or points to `axis->size` writable bytes. `machine` may be any value.
 */
ecmsk_result ecmsk_machine_get_axis(ecmsk_machine *machine,
                                    uint32_t index,
                                    ecmsk_axis *axis);

/**
 * Copies the name of an axis to the `length` bytes at `buffer`, as `ecmsk_get_link_name` does. A name has at most 32
 * characters, which are 128 bytes of UTF-8, and the terminating 0.
 *
 * # Safety
 * As for `ecmsk_get_link_name`. `machine` may be any value.
 */
ecmsk_result ecmsk_machine_get_axis_name(ecmsk_machine *machine,
                                         uint32_t index,
                                         char *buffer,
                                         size_t length,
                                         size_t *needed);

/**
 * Copies the unit of an axis to the `length` bytes at `buffer`, as `ecmsk_get_link_name` does: `mm`, `um`, `m`, `in`, `deg`,
 * `rad`, `turn` or `counts`.
 *
 * # Safety
 * As for `ecmsk_get_link_name`. `machine` may be any value.
 */
ecmsk_result ecmsk_machine_get_axis_unit(ecmsk_machine *machine,
                                         uint32_t index,
                                         char *buffer,
                                         size_t length,
                                         size_t *needed);

/**
 * Converts a position of an axis in units to the nearest count and writes that to `*counts`. What is beyond the 64 bits
 * becomes their end. A target of the board has 32 bits: compare with `min_counts` and `max_counts` of the axis before. The
 * result is `ECMSK_ERROR_ARGUMENT` if `units` is NaN.
 *
 * # Safety
 * `counts` is NULL or points to room for an `int64_t`. `machine` may be any value.
 */
ecmsk_result ecmsk_machine_to_counts(ecmsk_machine *machine,
                                     uint32_t index,
                                     double units,
                                     int64_t *counts);

/**
 * Converts a position of an axis in counts to units and writes that to `*units`, a finite number.
 *
 * # Safety
 * `units` is NULL or points to room for a `double`. `machine` may be any value.
 */
ecmsk_result ecmsk_machine_to_units(ecmsk_machine *machine, uint32_t index, int64_t counts, double *units);

/**
 * Writes the slave, from 1, and the bit, from 0, of the input with this name to `*slave` and `*bit`. Upper and lower case
 * are the same. Without such an input the result is `ECMSK_ERROR_ARGUMENT`.
 *
 * # Safety
 * `name` is NULL or a text in UTF-8 that ends with 0. `slave` and `bit` are NULL or point to room for a `uint32_t`.
 * `machine` may be any value.
 */
ecmsk_result ecmsk_machine_find_input(ecmsk_machine *machine,
                                      const char *name,
                                      uint32_t *slave,
                                      uint32_t *bit);

/**
 * Writes the slave, from 1, and the bit, from 0, of the output with this name to `*slave` and `*bit`, as
 * `ecmsk_machine_find_input` does.
 *
 * # Safety
 * As for `ecmsk_machine_find_input`.
 */
ecmsk_result ecmsk_machine_find_output(ecmsk_machine *machine, const char *name, uint32_t *slave, uint32_t *bit);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ECMSK_H */
