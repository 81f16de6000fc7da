/* LoadLibrary and GetProcAddress, by name or, with the argument `ordinals`, by ordinal; all of the register that bool comes
 * back in is 0 or 1, and the stack is where it was after each call. */
#include "loaded.h"

#ifdef __i386__
/* How far the stack pointer moves over a call with as many arguments: 0 if the function has taken them off. */
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
    /* Success of a write and a read leaves Windows' last error as it was. */
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
