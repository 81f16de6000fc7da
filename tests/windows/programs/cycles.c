/* Loads the DLL, opens the board, transfers a frame, closes and unloads, repeatedly: after each round the DLL is
 * unloaded, and at the end no thread, handle or TLS index is left. Arguments: rounds; `uri` (then ECMSK_LINK is opened
 * by ecmsk_open). */
#include "loaded.h"

#include <tlhelp32.h>

typedef int(__cdecl *open_uri_function)(const char *uri, void **board);
typedef int(__cdecl *close_uri_function)(void *board);

static unsigned threads(void)
{
    unsigned found = 0;
    THREADENTRY32 entry;
    HANDLE all = CreateToolhelp32Snapshot(TH32CS_SNAPTHREAD, 0);
    CHECK(all != INVALID_HANDLE_VALUE);
    entry.dwSize = sizeof entry;
    if (Thread32First(all, &entry)) {
        do {
            found += entry.th32OwnerProcessID == GetCurrentProcessId();
        } while (Thread32Next(all, &entry));
    }
    CloseHandle(all);
    return found;
}

static unsigned tls_indexes(void)
{
    static DWORD taken[2000];
    unsigned count = 0, i;
    while (count < 2000 && (taken[count] = TlsAlloc()) != TLS_OUT_OF_INDEXES) {
        count++;
    }
    for (i = 0; i < count; i++) {
        TlsFree(taken[i]);
    }
    return count;
}

static unsigned handles(void)
{
    DWORD count = 0;
    CHECK(GetProcessHandleCount(GetCurrentProcess(), &count));
    return count;
}

static void vendor_round(void)
{
    static unsigned char frame[512];
    HMODULE dll = load(DLL);
    CHECK(open_board() == 1);
    CHECK(write_board(frame, 512) == 1);
    CHECK(read_board(frame, 512) == 1);
    close_board();
    CHECK(read_board(frame, 512) == 0);
    CHECK(FreeLibrary(dll));
    last_error = NULL;
    CHECK(GetModuleHandleA(DLL) == NULL);
}

static void uri_round(const char *uri)
{
    void *board, *other;
    HMODULE dll = load(DLL);
    open_uri_function open_uri = FUNCTION(open_uri_function, dll, "ecmsk_open");
    close_uri_function close_uri = FUNCTION(close_uri_function, dll, "ecmsk_close");
    CHECK(open_uri(uri, &board) == 0);
    CHECK(open_uri(uri, &other) == 0);
    CHECK(close_uri(board) == 0);
    CHECK(close_uri(board) == -2);
    CHECK(close_uri(other) == 0);
    CHECK(FreeLibrary(dll));
    last_error = NULL;
    CHECK(GetModuleHandleA(DLL) == NULL);
}

int main(int count, char **arguments)
{
    char uri[500];
    int by_uri = count > 2 && strcmp(arguments[2], "uri") == 0;
    int rounds = atoi(arguments[1]), round;
    unsigned threads_before = 0, handles_before = 0, tls_before = 0;
    CHECK(GetEnvironmentVariableA("ECMSK_LINK", uri, sizeof uri) > 0);
    for (round = 0; round < rounds; round++) {
        if (by_uri) {
            uri_round(uri);
        } else {
            vendor_round();
        }
        /* No thread runs in an unloaded DLL. */
        CHECK(round == 0 || threads() == threads_before);
        if (round == 0) {
            /* Windows' own objects of the process exist now. */
            threads_before = threads();
            handles_before = handles();
            tls_before = tls_indexes();
        }
    }
    printf("threads %+d, handles %+d, TLS indexes %+d\n", (int)(threads() - threads_before),
           (int)(handles() - handles_before), (int)(tls_before - tls_indexes()));
    ok();
    return 0;
}
