/* A program that ends without Close, with a thread in a read. Argument: `return` from main, `exit` in another thread,
 * `process` for ExitProcess, `unload` for ExitProcess after FreeLibrary. */
#include "loaded.h"

static volatile LONG reading;

static DWORD WINAPI reader(void *unused)
{
    static unsigned char frame[512];
    (void)unused;
    while (read_board(frame, 512) == 1) {
        InterlockedIncrement(&reading);
    }
    return 0;
}

static DWORD WINAPI ender(void *unused)
{
    (void)unused;
    exit(0);
}

int main(int count, char **arguments)
{
    const char *how = count > 1 ? arguments[1] : "";
    HMODULE dll = load(DLL);
    CHECK(open_board() == 1);
    CHECK(CreateThread(NULL, 0, reader, NULL, 0, NULL) != NULL);
    while (reading == 0) {
        Sleep(1);
    }
    ok();
    if (strcmp(how, "exit") == 0) {
        CHECK(CreateThread(NULL, 0, ender, NULL, 0, NULL) != NULL);
        Sleep(INFINITE);
    } else if (strcmp(how, "process") == 0) {
        ExitProcess(0);
    } else if (strcmp(how, "unload") == 0) {
        CHECK(FreeLibrary(dll));
        ExitProcess(0);
    }
    return 0;
}
