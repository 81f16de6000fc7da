/* Declarations of msvcrt.dll, as far as the programs of the tests need them; see start.c. */
#ifndef STRING_H
#define STRING_H
#include <stddef.h>
#ifdef __cplusplus
extern "C" {
#endif
void *__cdecl memset(void *to, int value, size_t size);
void *__cdecl memcpy(void *to, const void *from, size_t size);
int __cdecl memcmp(const void *one, const void *other, size_t size);
int __cdecl strcmp(const char *one, const char *other);
size_t __cdecl strlen(const char *text);
#ifdef __cplusplus
char *__cdecl strstr(const char *in, const char *text);
}
#else
char *__cdecl strstr(const char *in, const char *text);
#endif
#endif
