/* What console programs of Visual Studio use of Windows, on Linux: with these folders such a program compiles as it is.
 *
 *     g++ -I share/msvc -I share/msvc/capital program.cpp -o program $(pkg-config --cflags --libs nextwusblib)
 *
 * The headers beside this one have the names that such programs include; `Windows.h` has a folder of its own, since systems that do not
 * tell capitals from small letters have one file of that name. What is not here is not there: the compiler says so.
 */
#ifndef ECMSK_MSVC_H
#define ECMSK_MSVC_H

#ifdef _WIN32
#error "On Windows the system's own headers have all of this."
#endif

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

typedef unsigned char BYTE;
typedef unsigned short WORD;
/* 32 bits, as on Windows: a `long` of Linux may have 64. */
typedef unsigned int DWORD;
typedef int LONG;
typedef unsigned int UINT;
typedef int BOOL;
typedef long long LONGLONG;
typedef unsigned long long ULONGLONG;

typedef union {
    struct {
        DWORD LowPart;
        LONG HighPart;
    } u;
    LONGLONG QuadPart;
} LARGE_INTEGER;

#ifndef TRUE
#define TRUE 1
#define FALSE 0
#endif

typedef char TCHAR;
typedef char _TCHAR;
#define _T(text) text
#define TEXT(text) text
#define _tmain main
#define _tprintf printf

static inline ULONGLONG ecmsk_msvc_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (ULONGLONG)now.tv_sec * 1000000000u + (ULONGLONG)now.tv_nsec;
}

/* Waits for so many milliseconds; 0 gives others a turn. A signal does not end it. */
static inline void Sleep(DWORD milliseconds)
{
    struct timespec left = {(time_t)(milliseconds / 1000), (long)(milliseconds % 1000) * 1000000};
    while (nanosleep(&left, &left) != 0 && errno == EINTR) {
    }
}

/* Milliseconds since some moment. It begins again at 0 after 49.7 days, as on Windows. */
static inline DWORD GetTickCount(void) { return (DWORD)(ecmsk_msvc_ns() / 1000000); }

static inline ULONGLONG GetTickCount64(void) { return ecmsk_msvc_ns() / 1000000; }

static inline DWORD timeGetTime(void) { return GetTickCount(); }

/* Sleeps are exact without them. */
static inline UINT timeBeginPeriod(UINT milliseconds) { return (void)milliseconds, 0; }

static inline UINT timeEndPeriod(UINT milliseconds) { return (void)milliseconds, 0; }

/* Nanoseconds. */
static inline BOOL QueryPerformanceFrequency(LARGE_INTEGER *frequency)
{
    frequency->QuadPart = 1000000000;
    return TRUE;
}

static inline BOOL QueryPerformanceCounter(LARGE_INTEGER *counter)
{
    counter->QuadPart = (LONGLONG)ecmsk_msvc_ns();
    return TRUE;
}

/* How the terminal was before the first look at a key; it is so again when the program ends. */
static struct termios ecmsk_msvc_before;

static inline void ecmsk_msvc_restore(void) { tcsetattr(STDIN_FILENO, TCSANOW, &ecmsk_msvc_before); }

/* Keys come one by one and are not shown. */
static inline void ecmsk_msvc_keys(void)
{
    static int is_set = 0;
    struct termios keys;
    if (is_set || !isatty(STDIN_FILENO) || tcgetattr(STDIN_FILENO, &ecmsk_msvc_before) != 0) {
        return;
    }
    is_set = 1;
    keys = ecmsk_msvc_before;
    keys.c_lflag &= ~(tcflag_t)(ICANON | ECHO);
    keys.c_cc[VMIN] = 1;
    keys.c_cc[VTIME] = 0;
    tcsetattr(STDIN_FILENO, TCSANOW, &keys);
    atexit(ecmsk_msvc_restore);
}

/* Whether a key was pressed that was not read yet. So it is at the end of a file or a pipe, too: _getch gives EOF then. */
static inline int _kbhit(void)
{
    struct pollfd input = {STDIN_FILENO, POLLIN, 0};
    ecmsk_msvc_keys();
    return poll(&input, 1, 0) > 0;
}

/* The next key; Enter is '\r', as on Windows. EOF: there is none any more. */
static inline int _getch(void)
{
    unsigned char key;
    fflush(stdout);
    ecmsk_msvc_keys();
    if (read(STDIN_FILENO, &key, 1) != 1) {
        return EOF;
    }
    return key == '\n' ? '\r' : key;
}

static inline int kbhit(void) { return _kbhit(); }

static inline int getch(void) { return _getch(); }

#define _stricmp strcasecmp
#define ZeroMemory(place, bytes) memset((place), 0, (bytes))

#endif
