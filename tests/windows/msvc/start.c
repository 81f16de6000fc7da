/* The entry point of programs built with Microsoft's conventions, since the start code of its C library is not
 * available. The library itself is the system's msvcrt.dll. */
#include <stdlib.h>

int main(int argc, char **argv);
void __cdecl __getmainargs(int *argc, char ***argv, char ***environment, int wildcards, int *new_mode);

/* Referenced by code that uses floating point. */
int _fltused = 0x9875;

void mainCRTStartup(void)
{
    int argc, new_mode = 0;
    char **argv, **environment;
    __getmainargs(&argc, &argv, &environment, 0, &new_mode);
    exit(main(argc, argv));
}
