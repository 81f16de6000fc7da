/* Machine files: axes with names, units and limits, conversions, inputs and outputs, the link; wrong files, wrong arguments,
 * handles that are closed or made up; threads that open, use and close them. The arguments are the files of behaviour.rs: a
 * whole one, one with an axis in counts alone, and wrong ones, each with a part of its error text. */
#define _POSIX_C_SOURCE 200112L /* setenv */
#include "check.h"

#include <float.h>
#include <math.h>
#include <pthread.h>
#include <stdint.h>

enum { THREADS = 4, ROUNDS = 100 };

/* The axis of the whole file with a name and a unit of several bytes. */
static const char *const turntable = "Gr\xC3\xB6\xC3\x9F" "e";

static ecmsk_machine *made_up(uintptr_t value) { return (ecmsk_machine *)value; }

static void a_bad_handle_is_an_error(ecmsk_machine *machine)
{
    char text[8];
    size_t needed = 5;
    uint32_t number = 5;
    double units = 5;
    int64_t counts = 5;
    ecmsk_axis axis;
    axis.size = sizeof axis;
    axis.slave = 5;
    CHECK(ecmsk_machine_get_link(machine, text, sizeof text, &needed) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_machine_get_axis_count(machine, &number) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_machine_find_axis(machine, "X", &number) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_machine_get_axis(machine, 0, &axis) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_machine_get_axis_name(machine, 0, text, sizeof text, &needed) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_machine_get_axis_unit(machine, 0, text, sizeof text, &needed) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_machine_to_counts(machine, 0, 1.0, &counts) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_machine_to_units(machine, 0, 1, &units) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_machine_find_input(machine, "door", &number, &number) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_machine_find_output(machine, "lamp", &number, &number) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_machine_close(machine) == ECMSK_ERROR_HANDLE);
    CHECK(last_error_has("no open machine file has the handle"));
    CHECK(needed == 5 && number == 5 && units == 5 && counts == 5 && axis.slave == 5);
}

static ecmsk_machine *open_file(const char *file)
{
    ecmsk_machine *machine = NULL;
    CHECK(ecmsk_machine_open(file, &machine) == ECMSK_OK);
    CHECK(machine != NULL);
    return machine;
}

static uint32_t index_of(ecmsk_machine *machine, const char *name)
{
    uint32_t index = 99;
    CHECK(ecmsk_machine_find_axis(machine, name, &index) == ECMSK_OK);
    return index;
}

static int64_t counts_of(ecmsk_machine *machine, uint32_t index, double units)
{
    int64_t counts = 99;
    CHECK(ecmsk_machine_to_counts(machine, index, units, &counts) == ECMSK_OK);
    return counts;
}

static double units_of(ecmsk_machine *machine, uint32_t index, int64_t counts)
{
    double units = 99;
    CHECK(ecmsk_machine_to_units(machine, index, counts, &units) == ECMSK_OK);
    return units;
}

static void axes(ecmsk_machine *machine)
{
    ecmsk_axis axis;
    uint32_t count = 99, index = 99;
    CHECK(ecmsk_machine_get_axis_count(machine, &count) == ECMSK_OK && count == 3);
    CHECK(index_of(machine, "X") == 0 && index_of(machine, "x") == 0);
    CHECK(index_of(machine, turntable) == 1 && index_of(machine, "GR\xC3\x96\xC3\x9F" "E") == 1);
    CHECK(index_of(machine, "Z") == 2);
    CHECK(ecmsk_machine_find_axis(machine, "Y", &index) == ECMSK_ERROR_ARGUMENT);
    CHECK(last_error_has("has no axis `Y`; it has X, Gr") && last_error_has(", Z"));
    CHECK(ecmsk_machine_find_axis(machine, "", &index) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_machine_find_axis(machine, "\xFF", &index) == ECMSK_ERROR_ARGUMENT);
    CHECK(last_error_has("`name` is not UTF-8"));
    CHECK(ecmsk_machine_find_axis(machine, NULL, &index) == ECMSK_ERROR_ARGUMENT);
    CHECK(index == 99);
    CHECK(ecmsk_machine_find_axis(machine, "X", NULL) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_machine_get_axis_count(machine, NULL) == ECMSK_ERROR_ARGUMENT);

    axis.size = sizeof axis;
    CHECK(ecmsk_machine_get_axis(machine, 0, &axis) == ECMSK_OK);
    CHECK(axis.size == sizeof axis && axis.slave == 1 && axis.counts_per_unit == 1000.0);
    CHECK(axis.min_units == -10.0 && axis.max_units == 250.5 && axis.min_counts == -10000 && axis.max_counts == 250500);
    CHECK(axis.max_velocity == 100.0 && axis.max_acceleration == 1000.5);
    /* The unit counts in the opposite direction: the lowest position is the highest count. There is no highest position. */
    CHECK(ecmsk_machine_get_axis(machine, 1, &axis) == ECMSK_OK);
    CHECK(axis.slave == 2 && axis.counts_per_unit == -131072.0 / 360.0);
    CHECK(axis.min_units == -90.0 && axis.max_units == INFINITY);
    CHECK(axis.min_counts == INT32_MIN && axis.max_counts == 32768);
    CHECK(axis.max_velocity == INFINITY && axis.max_acceleration == INFINITY);
    /* In counts, without a limit. */
    CHECK(ecmsk_machine_get_axis(machine, 2, &axis) == ECMSK_OK);
    CHECK(axis.slave == 4 && axis.counts_per_unit == 1.0);
    CHECK(axis.min_units == -INFINITY && axis.max_units == INFINITY);
    CHECK(axis.min_counts == INT32_MIN && axis.max_counts == INT32_MAX);

    CHECK(ecmsk_machine_get_axis(machine, 3, &axis) == ECMSK_ERROR_ARGUMENT);
    CHECK(last_error_has("has no axis with the index 3; it has those with the indexes 0 to 2"));
    CHECK(ecmsk_machine_get_axis(machine, UINT32_MAX, &axis) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_machine_get_axis(machine, 0, NULL) == ECMSK_ERROR_ARGUMENT);
}

/* A program that was built with an older, shorter structure gets the part that fits. */
static void sizes(ecmsk_machine *machine)
{
    struct {
        ecmsk_axis axis;
        unsigned char later[64];
    } newer;
    ecmsk_axis axis;
    memset(&axis, 0xA5, sizeof axis);
    axis.size = 19;
    CHECK(ecmsk_machine_get_axis(machine, 0, &axis) == ECMSK_OK);
    CHECK(axis.size == 16 && axis.slave == 1 && axis.counts_per_unit == 1000.0);
    CHECK(is_filled_with((unsigned char *)&axis + 16, sizeof axis - 16, 0xA5));
    memset(&newer, 0xA5, sizeof newer);
    newer.axis.size = sizeof newer;
    CHECK(ecmsk_machine_get_axis(machine, 0, &newer.axis) == ECMSK_OK);
    CHECK(newer.axis.size == sizeof axis && is_filled_with(newer.later, sizeof newer.later, 0xA5));
    for (axis.size = 0; axis.size < 8; axis.size++) {
        CHECK(ecmsk_machine_get_axis(machine, 0, &axis) == ECMSK_ERROR_ARGUMENT);
    }
    CHECK(last_error_has("sizeof"));
}

static void texts(ecmsk_machine *machine, const char *link_begins)
{
    char text[400];
    size_t needed = 0, length;
    ecmsk_board *board = NULL;

    CHECK(ecmsk_machine_get_axis_name(machine, 1, text, sizeof text, &needed) == ECMSK_OK);
    CHECK(strcmp(text, turntable) == 0 && needed == 8);
    CHECK(ecmsk_machine_get_axis_unit(machine, 1, text, sizeof text, &needed) == ECMSK_OK);
    CHECK(strcmp(text, "deg") == 0 && needed == 4);
    CHECK(ecmsk_machine_get_axis_unit(machine, 2, text, sizeof text, NULL) == ECMSK_OK);
    CHECK(strcmp(text, "counts") == 0);
    CHECK(ecmsk_machine_get_axis_name(machine, 3, text, sizeof text, &needed) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_machine_get_axis_unit(machine, 3, text, sizeof text, &needed) == ECMSK_ERROR_ARGUMENT);

    /* A text that is too long is cut between two characters, and no byte behind it is touched. */
    for (length = 1; length <= 9; length++) {
        memset(text, 0x7F, sizeof text);
        CHECK(ecmsk_machine_get_axis_name(machine, 1, text, length, &needed) == ECMSK_OK && needed == 8);
        CHECK(strlen(text) == (length == 4 ? 2 : length == 6 ? 4 : length > 8 ? 7 : length - 1));
        CHECK(strncmp(text, turntable, strlen(text)) == 0);
        CHECK(is_filled_with(text + length, sizeof text - length, 0x7F));
    }
    CHECK(ecmsk_machine_get_axis_name(machine, 1, NULL, 0, &needed) == ECMSK_OK && needed == 8);
    CHECK(ecmsk_machine_get_axis_name(machine, 1, NULL, 0, NULL) == ECMSK_OK);
    CHECK(ecmsk_machine_get_axis_name(machine, 1, NULL, 1, &needed) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_machine_get_axis_unit(machine, 1, NULL, 1, &needed) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_machine_get_link(machine, NULL, 1, &needed) == ECMSK_ERROR_ARGUMENT);

    /* The link opens the board with the slaves of the file. */
    CHECK(ecmsk_machine_get_link(machine, text, sizeof text, &needed) == ECMSK_OK);
    CHECK(needed == strlen(text) + 1 && strncmp(text, link_begins, strlen(link_begins)) == 0);
    CHECK(ecmsk_open(text, &board) == ECMSK_OK);
    CHECK(ecmsk_read(board, (unsigned char *)response, sizeof response, ECMSK_WAIT_LINK) == ECMSK_OK);
    CHECK(state() == STATE_PRE_OP);
    CHECK(ecmsk_close(board) == ECMSK_OK);
}

static void conversions(ecmsk_machine *machine)
{
    uint32_t x = 0, turned = 1, in_counts = 2;
    int64_t counts = 5;
    double units = 5;
    CHECK(counts_of(machine, x, 12.5) == 12500 && counts_of(machine, x, -0.0015) == -2 && counts_of(machine, x, 0.0004) == 0);
    CHECK(counts_of(machine, turned, 90.0) == -32768 && counts_of(machine, in_counts, -7.0) == -7);
    CHECK(units_of(machine, x, 12500) == 12.5 && units_of(machine, turned, 32768) == -90.0);
    /* The sign of a 0 would be printed. */
    CHECK(units_of(machine, turned, 0) == 0.0 && !signbit(units_of(machine, turned, 0)));
    /* More than the 32 bits of a position, and more than 64. */
    CHECK(counts_of(machine, x, 4e9) == 4000000000000LL && units_of(machine, x, 4000000000000LL) == 4e9);
    CHECK(counts_of(machine, x, 1e300) == INT64_MAX && counts_of(machine, turned, 1e300) == INT64_MIN);
    CHECK(counts_of(machine, x, DBL_MAX) == INT64_MAX && counts_of(machine, x, -INFINITY) == INT64_MIN);
    CHECK(units_of(machine, in_counts, INT64_MIN) == -9223372036854775808.0);
    CHECK(units_of(machine, x, INT64_MAX) == 9223372036854775807.0 / 1000.0);

    CHECK(ecmsk_machine_to_counts(machine, x, NAN, &counts) == ECMSK_ERROR_ARGUMENT);
    CHECK(last_error_has("NaN"));
    CHECK(ecmsk_machine_to_counts(machine, 3, 1.0, &counts) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_machine_to_units(machine, 3, 1, &units) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_machine_to_counts(machine, x, 1.0, NULL) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_machine_to_units(machine, x, 1, NULL) == ECMSK_ERROR_ARGUMENT);
    CHECK(counts == 5 && units == 5);
}

static void lines(ecmsk_machine *machine)
{
    uint32_t slave = 99, bit = 99;
    CHECK(ecmsk_machine_find_output(machine, "lamp", &slave, &bit) == ECMSK_OK && slave == 3 && bit == 15);
    CHECK(ecmsk_machine_find_input(machine, "Door", &slave, &bit) == ECMSK_OK && slave == 3 && bit == 0);
    slave = bit = 99;
    CHECK(ecmsk_machine_find_input(machine, "lamp", &slave, &bit) == ECMSK_ERROR_ARGUMENT);
    CHECK(last_error_has("has no input `lamp`; it has door"));
    CHECK(ecmsk_machine_find_output(machine, "door\n", &slave, &bit) == ECMSK_ERROR_ARGUMENT);
    CHECK(last_error_has("has no output `door\\n`; it has lamp"));
    CHECK(ecmsk_machine_find_input(machine, NULL, &slave, &bit) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_machine_find_output(machine, NULL, &slave, &bit) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_machine_find_input(machine, "door", NULL, &bit) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_machine_find_input(machine, "door", &slave, NULL) == ECMSK_ERROR_ARGUMENT);
    CHECK(slave == 99 && bit == 99);
}

/* A file that names no link, and no inputs. */
static void the_smallest_file(const char *file)
{
    ecmsk_machine *machine = open_file(file);
    char text[8];
    uint32_t number = 99;
    size_t needed = 0;
    memset(text, 0x7F, sizeof text);
    CHECK(ecmsk_machine_get_link(machine, text, sizeof text, &needed) == ECMSK_OK && needed == 1 && text[0] == 0);
    CHECK(ecmsk_machine_get_axis_count(machine, &number) == ECMSK_OK && number == 1);
    CHECK(ecmsk_machine_find_input(machine, "door", &number, &number) == ECMSK_ERROR_ARGUMENT);
    CHECK(last_error_has("has no input `door`; it has none"));
    CHECK(ecmsk_machine_close(machine) == ECMSK_OK);
}

static void wrong_files(char **pairs, int count)
{
    ecmsk_machine *machine = made_up(5);
    int i;
    for (i = 0; i + 1 < count; i += 2) {
        machine = made_up(5);
        CHECK(ecmsk_machine_open(pairs[i], &machine) == ECMSK_ERROR_ARGUMENT);
        CHECK(machine == NULL);
        CHECK(last_error_has(pairs[i + 1]) && last_error_has(pairs[i]));
    }
    machine = made_up(5);
    CHECK(ecmsk_machine_open("nonexistent.toml", &machine) == ECMSK_ERROR_IO);
    CHECK(machine == NULL);
    CHECK(last_error_has("cannot read the machine file nonexistent.toml: "));
    CHECK(ecmsk_machine_open("", &machine) == ECMSK_ERROR_IO);
    CHECK(ecmsk_machine_open("/", &machine) == ECMSK_ERROR_IO);
    CHECK(ecmsk_machine_open("/dev/zero", &machine) == ECMSK_ERROR_IO);
    CHECK(ecmsk_machine_open(NULL, &machine) == ECMSK_ERROR_ARGUMENT);
    CHECK(last_error_has("`file` is NULL"));
    CHECK(ecmsk_machine_open("\xFF\xFE", &machine) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_machine_open("machine.toml", NULL) == ECMSK_ERROR_ARGUMENT);
}

/* ECMSK_LINK, which `ecmsk exec --link` sets, goes before the link of the file. */
static void the_link_of_the_environment(const char *path)
{
    char text[512];
    size_t needed = 0;
    ecmsk_machine *machine = open_file(path);
    CHECK(ecmsk_machine_get_link(machine, text, sizeof text, &needed) == ECMSK_OK);
    /* It lists slaves, so that the board does not get those of the file. */
    CHECK(strncmp(text, "sim:?", 5) == 0 && strstr(text, "axes=") != NULL && strstr(text, "machine=") == NULL);
    CHECK(ecmsk_machine_close(machine) == ECMSK_OK);
    CHECK(setenv("ECMSK_LINK", "sims:", 1) == 0);
    machine = open_file(path);
    CHECK(ecmsk_machine_get_link(machine, text, sizeof text, &needed) == ECMSK_ERROR_ARGUMENT);
    CHECK(last_error_has("unknown scheme"));
    CHECK(ecmsk_machine_close(machine) == ECMSK_OK);
    CHECK(unsetenv("ECMSK_LINK") == 0);
}

static ecmsk_machine *shared;
static const char *whole;

static void *worker(void *unused)
{
    int round;
    (void)unused;
    for (round = 0; round < ROUNDS; round++) {
        ecmsk_machine *own = open_file(whole);
        int64_t counts = 0;
        ecmsk_result result = ecmsk_machine_to_counts(shared, 0, 1.5, &counts);
        CHECK(result == ECMSK_OK ? counts == 1500 : result == ECMSK_ERROR_HANDLE && counts == 0);
        CHECK(counts_of(own, 0, 2.5) == 2500);
        CHECK(ecmsk_machine_close(own) == ECMSK_OK);
        CHECK(ecmsk_machine_close(own) == ECMSK_ERROR_HANDLE);
    }
    return NULL;
}

/* Four threads use a file while a fifth closes it, and each opens and closes its own. */
static void threads(void)
{
    pthread_t ids[THREADS];
    int i;
    shared = open_file(whole);
    for (i = 0; i < THREADS; i++) {
        CHECK(pthread_create(&ids[i], NULL, worker, NULL) == 0);
    }
    CHECK(ecmsk_machine_close(shared) == ECMSK_OK);
    for (i = 0; i < THREADS; i++) {
        CHECK(pthread_join(ids[i], NULL) == 0);
    }
}

int main(int argc, char **argv)
{
    static const uintptr_t handles[] = {0, 1, 2, 16, 17, 4096, UINTPTR_MAX / 2, UINTPTR_MAX / 2 + 1, UINTPTR_MAX};
    ecmsk_machine *machine = NULL, *other = NULL;
    ecmsk_board *board = NULL;
    size_t i;

    CHECK(argc >= 4);
    whole = argv[1];
    for (i = 0; i < sizeof handles / sizeof handles[0]; i++) {
        a_bad_handle_is_an_error(made_up(handles[i]));
    }
    the_link_of_the_environment(whole);
    wrong_files(argv + 4, argc - 4);
    the_smallest_file(argv[2]);

    machine = open_file(whole);
    other = open_file(whole);
    CHECK(machine != other);
    axes(machine);
    sizes(machine);
    texts(machine, argv[3]);
    conversions(machine);
    lines(machine);

    /* A handle of the other kind is none. */
    CHECK(ecmsk_close((ecmsk_board *)machine) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_open("sim:?slaves=drive", &board) == ECMSK_OK);
    a_bad_handle_is_an_error((ecmsk_machine *)board);
    a_bad_handle_is_an_error((ecmsk_machine *)ecmsk_vendor_board());
    CHECK(ecmsk_close(board) == ECMSK_OK);

    CHECK(ecmsk_machine_close(machine) == ECMSK_OK);
    a_bad_handle_is_an_error(machine);
    axes(other);
    CHECK(ecmsk_machine_close(other) == ECMSK_OK);
    threads();
    puts("ok");
    return 0;
}
