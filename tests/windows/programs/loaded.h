/* Shared by the Windows programs of the tests: the DLL loaded by name, its functions declared from what is known of
 * the vendor's library, not from this project's header. `unsigned` is the whole register of the returned bool. */
#ifndef LOADED_H
#define LOADED_H

#include <windows.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef unsigned(__stdcall *open_function)(void);
typedef void(__stdcall *close_function)(void);
typedef unsigned(__stdcall *move_function)(unsigned char *data, unsigned long length);
typedef const char *(__cdecl *text_function)(void);

#define DLL "NEXTWUSBLib.dll"

static open_function open_board;
static close_function close_board;
static move_function write_board, read_board;
static text_function last_error;

#define CHECK(holds)                                                                       \
    do {                                                                                   \
        if (!(holds)) {                                                                    \
            fprintf(stderr, "%s:%d: %s; last error of Windows %lu, of the library: %s\n", __FILE__, \
                    __LINE__, #holds, GetLastError(), last_error ? last_error() : "");     \
            fflush(stderr);                                                                \
            TerminateProcess(GetCurrentProcess(), 1);                                      \
        }                                                                                  \
    } while (0)

static FARPROC function_of(HMODULE dll, const char *name)
{
    FARPROC found = GetProcAddress(dll, name);
    CHECK(found != NULL);
    return found;
}

/* A function's address with its type. */
#define FUNCTION(type, dll, name) ((type)(void *)function_of(dll, name))

static HMODULE load(const char *path)
{
    HMODULE dll = LoadLibraryA(path);
    last_error = NULL;
    CHECK(dll != NULL);
    open_board = FUNCTION(open_function, dll, "OpenECMUSB");
    close_board = FUNCTION(close_function, dll, "CloseECMUSB");
    write_board = FUNCTION(move_function, dll, "ECMUSBWrite");
    read_board = FUNCTION(move_function, dll, "ECMUSBRead");
    last_error = FUNCTION(text_function, dll, "ecmsk_last_error");
    return dll;
}

static inline void ok(void)
{
    puts("ok");
    fflush(stdout);
}

#endif
