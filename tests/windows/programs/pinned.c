/* FreeLibrary while the board is open: the DLL stays until the board is closed, even if the program closes it by the
 * address alone, and is unloaded then. Argument: `alone`; `read`: while another thread is blocked in a read; `close`:
 * FreeLibrary comes after that thread's end, which prints the reason; `uri`: a board of ecmsk_open. */
#include "loaded.h"

typedef int(__cdecl *open_uri_function)(const char *uri, void **board);
typedef int(__cdecl *close_uri_function)(void *board);

static volatile LONG reading;
static char said[500];

/* Reads until the board is closed. Only a caller that still has the DLL loaded may query the reason. */
static DWORD WINAPI reader(void *may_ask)
{
    static unsigned char frame[512];
    while (read_board(frame, 512) == 1) {
        InterlockedIncrement(&reading);
    }
    if (may_ask) {
        lstrcpynA(said, last_error(), sizeof said);
    }
    return 0;
}

int main(int count, char **arguments)
{
    static unsigned char frame[512];
    const char *how = count > 1 ? arguments[1] : "";
    HMODULE dll = load(DLL);
    if (strcmp(how, "uri") == 0) {
        void *board;
        char uri[500];
        open_uri_function open_uri = FUNCTION(open_uri_function, dll, "ecmsk_open");
        close_uri_function close_uri = FUNCTION(close_uri_function, dll, "ecmsk_close");
        CHECK(GetEnvironmentVariableA("ECMSK_LINK", uri, sizeof uri) > 0);
        CHECK(open_uri(uri, &board) == 0);
        CHECK(FreeLibrary(dll));
        CHECK(GetModuleHandleA(DLL) != NULL);
        CHECK(close_uri(board) == 0);
        CHECK(GetModuleHandleA(DLL) == NULL);
        ok();
        return 0;
    }
    CHECK(open_board() == 1);
    CHECK(write_board(frame, 512) == 1);
    if (strcmp(how, "alone") == 0) {
        CHECK(FreeLibrary(dll));
        CHECK(GetModuleHandleA(DLL) != NULL);
        CHECK(write_board(frame, 512) == 1);
        CHECK(read_board(frame, 512) == 1);
        close_board();
        CHECK(GetModuleHandleA(DLL) == NULL);
    } else {
        int kept = strcmp(how, "close") == 0;
        HANDLE thread = CreateThread(NULL, 0, reader, kept ? said : NULL, 0, NULL);
        CHECK(thread != NULL);
        while (reading == 0) {
            Sleep(1);
        }
        if (!kept) {
            CHECK(FreeLibrary(dll));
            CHECK(GetModuleHandleA(DLL) != NULL);
        }
        close_board();
        CHECK(WaitForSingleObject(thread, INFINITE) == WAIT_OBJECT_0);
        CloseHandle(thread);
        if (kept) {
            CHECK(strstr(said, "closed") != NULL || strstr(said, "call OpenECMUSB first") != NULL);
            CHECK(FreeLibrary(dll));
        }
        last_error = NULL;
        while (GetModuleHandleA(DLL) != NULL) {
            Sleep(1);
        }
    }
    ok();
    return 0;
}
