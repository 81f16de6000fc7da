/* From LoadLibrary to the return of the first OpenECMUSB, true, of two DLLs in turn, each of them unloaded before the next
 * round. Arguments: their paths, and the name of the figures. What goes to standard output are lines for
 * `cargo xtask bench`.
 *
 * Windows' own DLLs that ours needs are there already, as they are in a program with windows or with .NET: what is compared
 * is the two DLLs. What it takes in a program that has none of them stands beside it, as a fact. */
#include <windows.h>

#include <stdio.h>
#include <stdlib.h>

typedef unsigned(__stdcall *open_function)(void);
typedef void(__stdcall *close_function)(void);

/* Rounds that count, and those before them: by then the files are in memory. */
enum { ROUNDS = 301, WARM_UP = 20 };

struct times {
    double open, both;
};

static struct times ours[ROUNDS], empty[ROUNDS];

static void fails(const char *what)
{
    fprintf(stderr, "%s: Windows' error %lu\n", what, GetLastError());
    exit(1);
}

static double ns(LARGE_INTEGER from, LARGE_INTEGER to)
{
    LARGE_INTEGER frequency;
    QueryPerformanceFrequency(&frequency);
    return (double)(to.QuadPart - from.QuadPart) * 1e9 / (double)frequency.QuadPart;
}

static struct times measure(const char *path)
{
    LARGE_INTEGER start, loaded, opened;
    struct times times;
    HMODULE dll;
    open_function open_board;
    QueryPerformanceCounter(&start);
    dll = LoadLibraryA(path);
    if (dll == NULL)
        fails(path);
    open_board = (open_function)(void *)GetProcAddress(dll, "OpenECMUSB");
    if (open_board == NULL)
        fails("OpenECMUSB");
    QueryPerformanceCounter(&loaded);
    if (open_board() != 1)
        fails("OpenECMUSB gives false");
    QueryPerformanceCounter(&opened);
    times.open = ns(loaded, opened);
    times.both = ns(start, opened);
    ((close_function)(void *)GetProcAddress(dll, "CloseECMUSB"))();
    if (!FreeLibrary(dll))
        fails("FreeLibrary");
    if (GetModuleHandleA(path) != NULL)
        fails("it is still loaded");
    return times;
}

/* Loads the DLLs that one needs, for good. */
static void keep_needs(const char *path)
{
    char *image = (char *)LoadLibraryA(path);
    const IMAGE_NT_HEADERS *headers;
    const IMAGE_IMPORT_DESCRIPTOR *needed;
    if (image == NULL)
        fails(path);
    headers = (const IMAGE_NT_HEADERS *)(image + ((const IMAGE_DOS_HEADER *)image)->e_lfanew);
    needed = (const IMAGE_IMPORT_DESCRIPTOR *)(image + headers->OptionalHeader
                                                           .DataDirectory[IMAGE_DIRECTORY_ENTRY_IMPORT].VirtualAddress);
    for (; needed->Name != 0; needed++) {
        if (LoadLibraryA(image + needed->Name) == NULL)
            fails(image + needed->Name);
    }
    if (!FreeLibrary((HMODULE)image))
        fails("FreeLibrary");
}

static int compare(const void *left, const void *right)
{
    double a = *(const double *)left, b = *(const double *)right;
    return (a > b) - (a < b);
}

static double median(double *values)
{
    qsort(values, ROUNDS, sizeof *values, compare);
    return values[ROUNDS / 2];
}

#define MEDIAN(what)                          \
    (                                         \
        {                                     \
            for (int i = 0; i < ROUNDS; i++)  \
                values[i] = (what);           \
            median(values);                   \
        })

static void fact(const char *name, const char *of, double value)
{
    printf("{\"name\":\"%s_%s\",\"ours_ns\":null,\"baseline_ns\":null,\"ratio\":null,\"target\":null,"
           "\"value\":%.1f,\"unit\":\"us\"}\n", name, of, value / 1000);
}

static void measure_all(char **paths)
{
    for (int i = -WARM_UP; i < ROUNDS; i++) {
        struct times times[2];
        /* Who goes first changes, too. */
        for (int turn = 0; turn < 2; turn++) {
            int which = (turn ^ i) & 1;
            times[which] = measure(paths[which]);
        }
        if (i >= 0) {
            ours[i] = times[0];
            empty[i] = times[1];
        }
    }
}

int main(int count, char **arguments)
{
    static double values[ROUNDS];
    double alone;
    if (count != 4) {
        fputs("arguments: our DLL, the empty one, name of the figures\n", stderr);
        return 2;
    }
    measure_all(arguments + 1);
    alone = MEDIAN(ours[i].both);
    keep_needs(arguments[1]);
    measure_all(arguments + 1);
    printf("{\"name\":\"%s\",\"ours_ns\":%.1f,\"baseline_ns\":%.1f,\"ratio\":%.3f,\"target\":2.0,"
           "\"against\":\"an empty DLL\"}\n", arguments[3],
           MEDIAN(ours[i].both), MEDIAN(empty[i].both), MEDIAN(ours[i].both / empty[i].both));
    fact(arguments[3], "of_it_open", MEDIAN(ours[i].open));
    fact(arguments[3], "alone_in_a_program", alone);
    return 0;
}
