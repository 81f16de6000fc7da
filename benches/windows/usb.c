/* The library on a board on USB against a program that asks Windows' HID driver itself: opening and closing, and writes
 * alone; and the processor time of a program that has the board open and does nothing with it. The argument is the name of
 * the figures. What goes to standard output are lines for `cargo xtask bench`. */
#include <windows.h>

#include <hidsdi.h>
#include <setupapi.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "NEXTWUSBLib.h"

/* Rounds of opening, of so many writes, and of doing nothing for so long. The first round of each is not counted. */
enum { OPENS = 21, ROUNDS = 7, WRITES = 1500, IDLES = 3, IDLE_MS = 5000, TICK_MS = 16, REPORT = 512 };

static double ours[OPENS], bare[OPENS], ratio[OPENS];
static unsigned char frame[REPORT + 1];

static void fails(const char *what)
{
    fprintf(stderr, "%s: Windows' error %lu\n", what, GetLastError());
    exit(1);
}

static double now_ns(void)
{
    LARGE_INTEGER now, frequency;
    QueryPerformanceCounter(&now);
    QueryPerformanceFrequency(&frequency);
    return (double)now.QuadPart * 1e9 / (double)frequency.QuadPart;
}

/* The board's reports have their 512 bytes both ways. */
static BOOL is_board(const char *path)
{
    PHIDP_PREPARSED_DATA preparsed;
    HIDP_CAPS capabilities;
    HANDLE file = CreateFileA(path, 0, FILE_SHARE_READ | FILE_SHARE_WRITE, NULL, OPEN_EXISTING, 0, NULL);
    BOOL fits = FALSE;
    if (file == INVALID_HANDLE_VALUE)
        return FALSE;
    if (HidD_GetPreparsedData(file, &preparsed)) {
        fits = HidP_GetCaps(preparsed, &capabilities) == HIDP_STATUS_SUCCESS
            && capabilities.InputReportByteLength == REPORT + 1 && capabilities.OutputReportByteLength == REPORT + 1;
        HidD_FreePreparsedData(preparsed);
    }
    CloseHandle(file);
    return fits;
}

static HANDLE open_bare(void)
{
    HANDLE file = INVALID_HANDLE_VALUE;
    SP_DEVICE_INTERFACE_DATA interface_data;
    HDEVINFO list;
    GUID class;
    DWORD number;
    HidD_GetHidGuid(&class);
    list = SetupDiGetClassDevsA(&class, NULL, NULL, DIGCF_PRESENT | DIGCF_DEVICEINTERFACE);
    if (list == INVALID_HANDLE_VALUE)
        fails("SetupDiGetClassDevs");
    interface_data.cbSize = sizeof interface_data;
    for (number = 0; SetupDiEnumDeviceInterfaces(list, NULL, &class, number, &interface_data); number++) {
        static union {
            SP_DEVICE_INTERFACE_DETAIL_DATA_A data;
            char room[1024];
        } detail;
        detail.data.cbSize = sizeof detail.data;
        if (!SetupDiGetDeviceInterfaceDetailA(list, &interface_data, &detail.data, sizeof detail, NULL, NULL))
            fails("SetupDiGetDeviceInterfaceDetail");
        if (strstr(detail.data.DevicePath, "vid_16c0&pid_05df") != NULL && is_board(detail.data.DevicePath)) {
            file = CreateFileA(detail.data.DevicePath, GENERIC_READ | GENERIC_WRITE, FILE_SHARE_READ | FILE_SHARE_WRITE,
                               NULL, OPEN_EXISTING, FILE_FLAG_OVERLAPPED, NULL);
            break;
        }
    }
    SetupDiDestroyDeviceInfoList(list);
    if (file == INVALID_HANDLE_VALUE)
        fails("no board");
    return file;
}

static void write_bare(HANDLE file, HANDLE event)
{
    OVERLAPPED transfer;
    DWORD moved;
    memset(&transfer, 0, sizeof transfer);
    transfer.hEvent = event;
    if (!WriteFile(file, frame, sizeof frame, NULL, &transfer) && GetLastError() != ERROR_IO_PENDING)
        fails("WriteFile");
    if (!GetOverlappedResult(file, &transfer, &moved, TRUE) || moved != sizeof frame)
        fails("GetOverlappedResult");
}

static double opening_bare(void)
{
    double from = now_ns(), took;
    HANDLE file = open_bare();
    took = now_ns() - from;
    CloseHandle(file);
    return took;
}

static double opening_ours(void)
{
    double from = now_ns(), took;
    if (!OpenECMUSB())
        fails("OpenECMUSB");
    took = now_ns() - from;
    CloseECMUSB();
    return took;
}

static double writing_bare(void)
{
    HANDLE file = open_bare(), event = CreateEventA(NULL, TRUE, FALSE, NULL);
    double from = now_ns(), took;
    for (int i = 0; i < WRITES; i++)
        write_bare(file, event);
    took = now_ns() - from;
    CloseHandle(event);
    CloseHandle(file);
    return took / WRITES;
}

/* From when it has written alone for a while, as a program does that has a machine to feed. */
static double writing_ours(void)
{
    double from, took;
    if (!OpenECMUSB())
        fails("OpenECMUSB");
    from = now_ns();
    while (now_ns() - from < 500e6) {
        if (!ECMUSBWrite(frame + 1, REPORT))
            fails("ECMUSBWrite");
    }
    from = now_ns();
    for (int i = 0; i < WRITES; i++) {
        if (!ECMUSBWrite(frame + 1, REPORT))
            fails("ECMUSBWrite");
    }
    took = now_ns() - from;
    CloseECMUSB();
    return took / WRITES;
}

static double processor_ms(void)
{
    FILETIME made, ended, kernel, user;
    if (!GetProcessTimes(GetCurrentProcess(), &made, &ended, &kernel, &user))
        fails("GetProcessTimes");
    return ((double)kernel.dwLowDateTime + (double)user.dwLowDateTime
            + 4294967296.0 * (kernel.dwHighDateTime + user.dwHighDateTime)) / 1e4;
}

/* Processor time of this process, from a second after the opening on. It is counted in ticks of 10 to 16 ms: one more keeps
 * the ratio of two short times from being that of their last ticks. */
static double idle_ns(void)
{
    double from;
    Sleep(1000);
    from = processor_ms();
    Sleep(IDLE_MS);
    return (processor_ms() - from + TICK_MS) * 1e6;
}

static double idle_bare(void)
{
    HANDLE file = open_bare();
    double took = idle_ns();
    CloseHandle(file);
    return took;
}

static double idle_ours(void)
{
    double took;
    if (!OpenECMUSB())
        fails("OpenECMUSB");
    took = idle_ns();
    CloseECMUSB();
    return took;
}

static int compare(const void *left, const void *right)
{
    double a = *(const double *)left, b = *(const double *)right;
    return (a > b) - (a < b);
}

static double median(double *values, int count)
{
    qsort(values, count, sizeof *values, compare);
    return values[count / 2];
}

static void pair(const char *name, const char *what, int rounds, double (*one)(void), double (*other)(void), double target)
{
    for (int i = -1; i < rounds; i++) {
        double a = one(), b = other();
        if (i >= 0) {
            ours[i] = a;
            bare[i] = b;
            ratio[i] = a / b;
        }
    }
    printf("{\"name\":\"%s_%s\",\"ours_ns\":%.1f,\"baseline_ns\":%.1f,\"ratio\":%.3f,\"target\":%.2f,"
           "\"against\":\"a program that asks the driver itself\"}\n",
           name, what, median(ours, rounds), median(bare, rounds), median(ratio, rounds), target);
    fflush(stdout);
}

int main(int count, char **arguments)
{
    double first;
    if (count != 2) {
        fputs("argument: name of the figures\n", stderr);
        return 2;
    }
    first = opening_ours();
    printf("{\"name\":\"%s_first_open\",\"ours_ns\":null,\"baseline_ns\":null,\"ratio\":null,\"target\":null,"
           "\"value\":%.1f,\"unit\":\"us\"}\n", arguments[1], first / 1000);
    pair(arguments[1], "open", OPENS, opening_ours, opening_bare, 1.5);
    pair(arguments[1], "writes_alone", ROUNDS, writing_ours, writing_bare, 1.08);
    pair(arguments[1], "idle", IDLES, idle_ours, idle_bare, 1.5);
    return 0;
}
