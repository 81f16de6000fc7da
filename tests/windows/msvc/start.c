/* Where programs built with Microsoft's conventions begin: its C library's start is not ours to have. The library itself is
 * the system's msvcrt.dll. */
#include <stdlib.h>

int main(int argc, char **argv);
void __cdecl __getmainargs(int *argc, char ***argv, char ***environment, int wildcards, int *new_mode);

/* Whoever uses floating point asks for it. */
int _fltused = 0x9875;

void mainCRTStartup(void)
{
    int argc, new_mode = 0;
    char **argv, **environment;
    __getmainargs(&argc, &argv, &environment, 0, &new_mode);
    exit(main(argc, argv));
}
