/* Declarations of msvcrt.dll, as far as the programs of the tests need them; see start.c. */
#ifndef STDIO_H
#define STDIO_H
#include <stddef.h>
#ifdef __cplusplus
extern "C" {
#endif
/* Only its size matters: there is an array of three. */
typedef struct {
    char *at;
    int left;
    char *base;
    int flags, file, character, size;
    char *name;
} FILE;
FILE *__cdecl __iob_func(void);
#define stdin (&__iob_func()[0])
#define stdout (&__iob_func()[1])
#define stderr (&__iob_func()[2])
int __cdecl printf(const char *format, ...);
int __cdecl fprintf(FILE *file, const char *format, ...);
int __cdecl puts(const char *text);
int __cdecl fflush(FILE *file);
#ifdef __cplusplus
}
#endif
#endif
