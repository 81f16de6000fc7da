/* The functions for threads (one-time calls, mutexes) that the unwinder of 32-bit MinGW (libgcc_eh) calls, for the
 * DLL. MinGW has them in its library winpthreads. That library takes one of the process's 1088 TLS indexes when a DLL is loaded
 * and never gives it back. The functions here take none. They come before the libraries when the DLL is linked, so that the
 * linker takes nothing from winpthreads. */
#include <windows.h>

int pthread_once(volatile LONG *once, void (*work)(void))
{
    while (*once != 1) {
        if (InterlockedCompareExchange(once, 2, 0) == 0) {
            work();
            InterlockedExchange(once, 1);
        } else {
            Sleep(0);
        }
    }
    return 0;
}

int pthread_mutex_init(SRWLOCK *mutex, const void *attributes)
{
    (void)attributes;
    mutex->Ptr = NULL;
    return 0;
}

int pthread_mutex_lock(SRWLOCK *mutex)
{
    AcquireSRWLockExclusive(mutex);
    return 0;
}

int pthread_mutex_unlock(SRWLOCK *mutex)
{
    ReleaseSRWLockExclusive(mutex);
    return 0;
}
