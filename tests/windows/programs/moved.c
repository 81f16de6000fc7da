/* The DLL at another base than its preferred one, which is occupied when it is loaded: the argument is that base.
 * Threads of the library and of this program use thread-local data. */
#include "loaded.h"

static DWORD WINAPI reads(void *count)
{
    static unsigned char frame[512];
    CHECK(read_board(NULL, 512) == 0);
    CHECK(strlen(last_error()) > 0);
    for (int i = 0; i < *(int *)count; i++)
        CHECK(read_board(frame, 512) == 1);
    return 0;
}

int main(int count, char **arguments)
{
    static unsigned char frame[512];
    int reports = 50;
    CHECK(count == 2);
    void *base = (void *)(size_t)_strtoui64(arguments[1], NULL, 16);
    CHECK(VirtualAlloc(base, 65536, MEM_RESERVE, PAGE_NOACCESS) != NULL || GetModuleHandleA(NULL) != base);
    HMODULE dll = load(DLL);
    CHECK((void *)dll != base);
    CHECK(open_board() == 1);
    HANDLE reader = CreateThread(NULL, 0, reads, &reports, 0, NULL);
    CHECK(reader != NULL);
    for (int i = 0; i < reports; i++)
        CHECK(write_board(frame, 512) == 1);
    CHECK(WaitForSingleObject(reader, 60000) == WAIT_OBJECT_0);
    close_board();
    CHECK(write_board(frame, 512) == 0);
    CHECK(strlen(last_error()) > 0);
    CHECK(FreeLibrary(dll));
    ok();
    return 0;
}
