/* GetLastError after each call, as with the vendor's library. The argument selects the end of a board: `reset` (the
 * board is lost), `closed` (it is silent, and Close ends a read that waits), `fails` (there is none). */
#include "../../c/check.h"

#include <windows.h>

/* The call leaves the earlier value 12345, or sets another one. */
#define LEAVES(call, expected)                                                                                    \
    do {                                                                                                          \
        DWORD left;                                                                                               \
        SetLastError(12345);                                                                                      \
        CHECK(call);                                                                                              \
        left = GetLastError();                                                                                    \
        if (left != (expected)) {                                                                                 \
            fprintf(stderr, "%s:%d: after %s Windows' last error is %lu\n", __FILE__, __LINE__, #call, left);     \
            exit(1);                                                                                              \
        }                                                                                                         \
    } while (0)

static bool closes(void)
{
    CloseECMUSB();
    return true;
}

static void not_open(void)
{
    LEAVES(!read_response(), ERROR_INVALID_HANDLE);
    LEAVES(!write_command(), ERROR_INVALID_HANDLE);
    LEAVES(closes(), 12345);
}

static void lengths(void)
{
    LEAVES(!ECMUSBWrite(NULL, 504), ERROR_INVALID_PARAMETER);
    LEAVES(!ECMUSBRead((unsigned char *)response, 0), ERROR_INVALID_PARAMETER);
}

static void reset(void)
{
    int tries;
    LEAVES(read_response(), 12345);
    LEAVES(write_command(), 12345);
    LEAVES(OpenECMUSB(), 0);
    CHECK(master(SW_RESET, 0, 0, 0));
    for (tries = 0; tries < 2000 && read_response(); tries++) {
    }
    LEAVES(!read_response(), ERROR_ACCESS_DENIED);
    LEAVES(!write_command(), ERROR_ACCESS_DENIED);
}

static DWORD WINAPI reader(LPVOID unused)
{
    unsigned char buffer[512];
    (void)unused;
    SetLastError(12345);
    CHECK(!ECMUSBRead(buffer, sizeof buffer));
    return GetLastError();
}

/* Two threads that wait in a read: Close ends both. */
static void closed(void)
{
    DWORD wait, left[2];
    for (wait = 100;; wait *= 4) {
        HANDLE threads[2];
        int i;
        for (i = 0; i < 2; i++) {
            threads[i] = CreateThread(NULL, 0, reader, NULL, 0, NULL);
            CHECK(threads[i] != NULL);
        }
        /* Until they wait in the call. */
        Sleep(wait);
        LEAVES(closes(), 12345);
        for (i = 0; i < 2; i++) {
            CHECK(WaitForSingleObject(threads[i], INFINITE) == WAIT_OBJECT_0);
            CHECK(GetExitCodeThread(threads[i], &left[i]));
            CloseHandle(threads[i]);
            CHECK(left[i] == ERROR_ACCESS_DENIED || left[i] == ERROR_INVALID_HANDLE);
        }
        if (left[0] == ERROR_ACCESS_DENIED && left[1] == ERROR_ACCESS_DENIED) {
            return;
        }
        /* One came later, when no board was open any more. */
        CHECK(wait < 60000);
        LEAVES(OpenECMUSB(), 0);
    }
}

int main(int count, char **arguments)
{
    not_open();
    if (count > 1 && strcmp(arguments[1], "fails") == 0) {
        LEAVES(!OpenECMUSB(), 0);
        not_open();
        puts("ok");
        return 0;
    }
    LEAVES(OpenECMUSB(), 0);
    lengths();
    if (count > 1 && strcmp(arguments[1], "closed") == 0) {
        closed();
    } else {
        reset();
        LEAVES(closes(), 12345);
    }
    not_open();
    puts("ok");
    return 0;
}
