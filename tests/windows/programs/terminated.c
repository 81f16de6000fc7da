/* Watchdogs of old programs end a thread that waits in ECMUSBRead by TerminateThread. Reads and writes of other
 * threads, Close, and the next Open work all the same. The argument is whether the board sends `reports` or is
 * `silent`. With `crowd` it sends reports, and many threads read at once, so that one may wait for another one's lock when
 * it is ended. */
#include "../../c/check.h"

#include <windows.h>

enum { ROUNDS = 12, CROWD = 8 };

static volatile LONG waiting;
static bool silent;

static DWORD WINAPI reader(LPVOID buffer)
{
    InterlockedIncrement(&waiting);
    while (ECMUSBRead((unsigned char *)buffer, 512)) {
    }
    return 0;
}

static HANDLE start(unsigned char *buffer)
{
    HANDLE thread;
    waiting = 0;
    thread = CreateThread(NULL, 0, reader, buffer, 0, NULL);
    CHECK(thread != NULL);
    while (!waiting) {
        Sleep(1);
    }
    /* It waits in the call by then. */
    Sleep(50);
    return thread;
}

/* Whether a suspended thread waits in a system call. Outside of one it may hold a lock of the system, which nobody
 * could release after its end. */
static bool waits(HANDLE thread)
{
    static const char *const calls[] = {"NtDelayExecution", "NtRemoveIoCompletion", "NtRemoveIoCompletionEx",
                                        "NtWaitForAlertByThreadId", "NtWaitForKeyedEvent",
                                        "NtWaitForMultipleObjects", "NtWaitForSingleObject"};
    enum { STUB_BYTES = 48 };
    CONTEXT context;
    ULONG_PTR at;
    size_t n;
    memset(&context, 0, sizeof context);
    context.ContextFlags = CONTEXT_CONTROL;
    CHECK(GetThreadContext(thread, &context));
#ifdef _WIN64
    at = context.Rip;
#else
    at = context.Eip;
#endif
    for (n = 0; n < sizeof calls / sizeof *calls; n++) {
        ULONG_PTR begin = (ULONG_PTR)GetProcAddress(GetModuleHandleA("ntdll"), calls[n]);
        if (begin != 0 && at > begin && at < begin + STUB_BYTES) {
            return true;
        }
    }
    return false;
}

static void terminate(HANDLE thread)
{
    DWORD pause;
    for (pause = 0;; pause = 1 - pause) {
        CHECK(SuspendThread(thread) != (DWORD)-1);
        if (waits(thread)) {
            break;
        }
        CHECK(ResumeThread(thread) != (DWORD)-1);
        /* Under Wine on one processor a thread that is suspended again at once may never go on. */
        Sleep(pause);
    }
    CHECK(TerminateThread(thread, 1));
    CHECK(WaitForSingleObject(thread, INFINITE) == WAIT_OBJECT_0);
    CloseHandle(thread);
}

static void open_board(void)
{
    while (!OpenECMUSB()) {
        Sleep(100);
    }
}

/* The program's next calls. On a silent board a read ends only by Close. */
static void goes_on(void)
{
    CHECK(write_command());
    if (silent) {
        static unsigned char buffer[512];
        HANDLE thread = start(buffer);
        CloseECMUSB();
        CHECK(WaitForSingleObject(thread, INFINITE) == WAIT_OBJECT_0);
        CloseHandle(thread);
        open_board();
    } else {
        CHECK(read_response());
    }
    CHECK(write_command());
}

int main(int count, char **arguments)
{
    static unsigned char buffers[CROWD][512];
    HANDLE readers[CROWD];
    bool crowd = count > 1 && strcmp(arguments[1], "crowd") == 0;
    int round;
    silent = count > 1 && strcmp(arguments[1], "silent") == 0;
    open_board();
    for (round = 0; round < ROUNDS; round++) {
        int n, threads = crowd ? CROWD : 1 + round % 2;
        for (n = 0; n < threads; n++) {
            readers[n] = start(buffers[n]);
        }
        for (n = 0; n < threads; n++) {
            terminate(readers[n]);
        }
        if (round % 3 != 2) {
            goes_on();
        }
        if (round % 3 != 1) {
            CloseECMUSB();
            CHECK(!write_command());
            open_board();
            goes_on();
        }
    }
    CloseECMUSB();
    puts("ok");
    return 0;
}
