/* LoadLibrary and GetProcAddress, by name or, with the argument `ordinals`, by ordinal; the whole register of the
 * returned bool is 0 or 1, and the stack pointer is unchanged after each call. */
#include "loaded.h"

#ifdef __i386__
/* The change of the stack pointer by a call with that many arguments: 0 if the function has removed them. */
static size_t moved(void *function, int arguments)
{
    static unsigned char frame[512];
    unsigned char *address = frame;
    size_t left;
    __asm__ volatile("movl %%esp, %%edi\n\t"
                     "testl %%edx, %%edx\n\t"
                     "jz 1f\n\t"
                     "pushl $512\n\t"
                     "pushl %%ecx\n\t"
                     "1: call *%%eax\n\t"
                     "movl %%edi, %%esi\n\t"
                     "subl %%esp, %%esi\n\t"
                     "movl %%edi, %%esp"
                     : "=&S"(left), "+a"(function), "+c"(address), "+d"(arguments)
                     :
                     : "edi", "memory", "cc");
    return left;
}
#endif

int main(int count, char **arguments)
{
    static unsigned char frame[512];
    HMODULE dll = load(DLL);
    if (count > 1 && strcmp(arguments[1], "ordinals") == 0) {
        open_board = FUNCTION(open_function, dll, MAKEINTRESOURCEA(1));
        close_board = FUNCTION(close_function, dll, MAKEINTRESOURCEA(2));
        write_board = FUNCTION(move_function, dll, MAKEINTRESOURCEA(3));
        read_board = FUNCTION(move_function, dll, MAKEINTRESOURCEA(4));
    }
    CHECK(GetProcAddress(dll, "_OpenECMUSB@0") == NULL);
    CHECK(read_board(frame, 512) == 0);
    CHECK(GetLastError() == 6);
    SetLastError(12345);
    CHECK(write_board(frame, 512) == 0);
    CHECK(GetLastError() == 6);
    CHECK(open_board() == 1);
    CHECK(GetLastError() == 0);
    SetLastError(12345);
    CHECK(open_board() == 1);
    CHECK(GetLastError() == 0);
    SetLastError(12345);
    CHECK(write_board(frame, 512) == 1);
    CHECK(read_board(frame, 512) == 1);
    /* A successful write or read leaves Windows' last error unchanged. */
    CHECK(GetLastError() == 12345);
    CHECK(write_board(NULL, 512) == 0);
    CHECK(read_board(NULL, 512) == 0);
    close_board();
    CHECK(write_board(frame, 512) == 0);
#ifdef __i386__
    CHECK(moved((void *)open_board, 0) == 0);
    CHECK(moved((void *)write_board, 2) == 0);
    CHECK(moved((void *)read_board, 2) == 0);
    CHECK(moved((void *)close_board, 0) == 0);
#endif
    ok();
    return 0;
}
