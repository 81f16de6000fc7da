/* The library on a board of Windows' HID driver. The first argument selects the case; the program signals the test
 * by a line of the output, and the test signals the program by a file in the program's folder. */
#include "check.h"

#include <windows.h>

#define SIZE 512

static unsigned char buffer[SIZE];
/* The last transferred frame, which a failed read returns. */
static unsigned char last[SIZE];

static void say(const char *line)
{
    puts(line);
    fflush(stdout);
}

static void wait_for(const char *file)
{
    while (GetFileAttributesA(file) == INVALID_FILE_ATTRIBUTES) {
        Sleep(10);
    }
}

static bool read_report(void)
{
    memset(buffer, 0xA5, sizeof buffer);
    if (ECMUSBRead(buffer, sizeof buffer)) {
        memcpy(last, buffer, sizeof last);
        return true;
    }
    CHECK(memcmp(buffer, last, sizeof last) == 0);
    return false;
}

static bool write_kept(void)
{
    memset(last, 0, sizeof last);
    memcpy(last, command, sizeof command);
    return write_command();
}

static unsigned long long dropped(void)
{
    ecmsk_stats stats;
    stats.size = sizeof stats;
    CHECK(ecmsk_get_stats(ecmsk_vendor_board(), &stats) == ECMSK_OK);
    return stats.reports_dropped;
}

/* Until the board is available. */
static void open_board(void)
{
    while (!OpenECMUSB()) {
        Sleep(100);
    }
}

/* A read before any write; then frames with their numbers, each followed by a read. A successful Open sets Windows'
 * last error to 0, other successful calls leave it unchanged. */
static void moves(unsigned frames)
{
    unsigned number;
    SetLastError(12345);
    open_board();
    CHECK(GetLastError() == 0);
    SetLastError(12345);
    CHECK(read_report() && buffer[2] == STATE_PRE_OP);
    for (number = 1; number <= frames; number++) {
        memset(buffer, 0, sizeof buffer);
        memcpy(buffer + 16, &number, sizeof number);
        memset(buffer + 504, (unsigned char)number, 8);
        CHECK(ECMUSBWrite(buffer, sizeof buffer));
        CHECK(read_report() && buffer[2] == STATE_PRE_OP);
    }
    CHECK(GetLastError() == 12345);
    CloseECMUSB();
    CHECK(GetLastError() == 12345);
}

/* Without reads the board sends reports and is lost: once a write has reported the loss, earlier reports are not
 * read any more. Windows' last error is that the board is lost. A write on the wire at that time may fail with an error
 * of the wire instead, and no other one. */
static void lost_with_reports(void)
{
    int tries;
    open_board();
    CHECK(read_report());
    say("open");
    wait_for("back");
    for (tries = 0; write_kept() || GetLastError() == ERROR_GEN_FAILURE; tries++) {
        CHECK(GetLastError() != ERROR_GEN_FAILURE || last_error_has("input/output error"));
        CHECK(tries < 2000);
        Sleep(10);
    }
    CHECK(GetLastError() == ERROR_ACCESS_DENIED);
    SetLastError(12345);
    CHECK(!read_report());
    CHECK(GetLastError() == ERROR_ACCESS_DENIED);
    CloseECMUSB();
    CHECK(!read_report());
    CHECK(GetLastError() == ERROR_INVALID_HANDLE);
}

/* No board: false, and a text with these parts. */
static void none(int count, char **parts)
{
    int i;
    CHECK(!OpenECMUSB());
    for (i = 0; i < count; i++) {
        CHECK(last_error_has(parts[i]));
    }
    CHECK(!read_report());
    CHECK(!write_kept());
}

/* The board is lost while a read waits, and returns: unusable until Open, which needs no Close. */
static void lost(void)
{
    open_board();
    say("open");
    while (read_report()) {
    }
    CHECK(GetLastError() == ERROR_ACCESS_DENIED);
    CHECK(last_error_has("open it again"));
    CHECK(!write_kept());
    CHECK(GetLastError() == ERROR_ACCESS_DENIED);
    say("lost");
    wait_for("back");
    CHECK(!read_report());
    CHECK(!write_kept());
    open_board();
    CHECK(read_report() && buffer[2] == STATE_PRE_OP);
    CHECK(write_kept());
}

static volatile LONG reads;

static DWORD WINAPI reader(LPVOID unused)
{
    (void)unused;
    InterlockedIncrement(&reads);
    CHECK(!read_report());
    CHECK(GetLastError() == ERROR_ACCESS_DENIED);
    CHECK(last_error_has("closed"));
    return 0;
}

/* The board is silent: Close ends the waiting read. */
static void close_ends(void)
{
    int round;
    for (round = 0; round < 5; round++) {
        HANDLE thread;
        reads = 0;
        open_board();
        thread = CreateThread(NULL, 0, reader, NULL, 0, NULL);
        CHECK(thread != NULL);
        while (!reads) {
            Sleep(1);
        }
        Sleep(50);
        CloseECMUSB();
        CHECK(WaitForSingleObject(thread, INFINITE) == WAIT_OBJECT_0);
        CloseHandle(thread);
    }
}

/* The board is silent, and reads have a limit. */
static void limits(void)
{
    int i;
    open_board();
    for (i = 0; i < 3; i++) {
        CHECK(!read_report());
        CHECK(last_error_has("timed out"));
    }
    CHECK(write_kept());
}

/* Without reads the newest 32 are kept, older ones are counted. */
static void unread(void)
{
    int i;
    open_board();
    while (dropped() < 40) {
        Sleep(10);
    }
    for (i = 0; i < 33; i++) {
        CHECK(read_report() && buffer[2] == STATE_PRE_OP);
    }
}

/* Only writes for a while, so that reports stay in the driver; then the newest of them are read, in order. */
static void rests(void)
{
    DWORD begun;
    int round, i;
    open_board();
    for (round = 0; round < 3; round++) {
        memset(command, 0, sizeof command);
        for (begun = GetTickCount(); GetTickCount() - begun < 600;) {
            CHECK(write_kept());
        }
        declare_drives();
        /* More reports than are kept. */
        Sleep(200);
        for (i = 0; i < 100; i++) {
            CHECK(read_response() && state() == STATE_PRE_OP);
            CHECK(response[0].CMD == SET_AXIS);
        }
    }
    CloseECMUSB();
}

/* Keeps the board open, with reports, until it is signalled to end. */
static void shares(const char *end)
{
    int i;
    open_board();
    CHECK(read_report());
    say("open");
    wait_for(end);
    /* All waiting reports, and more. */
    for (i = 0; i < 100; i++) {
        CHECK(read_report() && buffer[2] == STATE_PRE_OP);
    }
    CHECK(write_kept());
    CloseECMUSB();
}

/* The board does not accept a frame: false, and reports go on. */
static void busy(void)
{
    open_board();
    CHECK(read_report());
    CHECK(!write_kept());
    CHECK(GetLastError() == ERROR_GEN_FAILURE);
    /* The limit of the link; or the kernel's own, where Wine does not come back from the call before that. */
    CHECK(last_error_has("took no byte") || last_error_has("input/output error"));
    CHECK(read_report());
}

int main(int count, char **arguments)
{
    const char *what = count > 1 ? arguments[1] : "";
    if (strcmp(what, "moves") == 0) {
        moves((unsigned)atoi(arguments[2]));
    } else if (strcmp(what, "none") == 0) {
        none(count - 2, arguments + 2);
    } else if (strcmp(what, "lost") == 0) {
        lost();
    } else if (strcmp(what, "lost_with_reports") == 0) {
        lost_with_reports();
    } else if (strcmp(what, "close") == 0) {
        close_ends();
    } else if (strcmp(what, "limits") == 0) {
        limits();
    } else if (strcmp(what, "unread") == 0) {
        unread();
    } else if (strcmp(what, "rests") == 0) {
        rests();
    } else if (strcmp(what, "shares") == 0) {
        shares(arguments[2]);
    } else if (strcmp(what, "busy") == 0) {
        busy();
    } else {
        CHECK(!"an argument that says what is tried");
    }
    say("ok");
    return 0;
}
