/* Declarations of msvcrt.dll, as far as the programs of the tests need them; see start.c. */
#ifndef STDLIB_H
#define STDLIB_H
#include <stddef.h>
#ifdef __cplusplus
extern "C" {
#endif
__declspec(noreturn) void __cdecl exit(int code);
int __cdecl abs(int number);
int __cdecl atoi(const char *text);
void *__cdecl malloc(size_t size);
void __cdecl free(void *memory);
#ifdef __cplusplus
}
#endif
#endif
