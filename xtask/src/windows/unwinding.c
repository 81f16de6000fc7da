/* What the unwinder of 32-bit MinGW (libgcc_eh) needs of threads, for the DLL. MinGW has it in winpthreads, which takes one of the
 * process's 1088 TLS indexes while a DLL is loaded and never gives it back. These take none. They come before the libraries when
 * the DLL is linked, so that nothing of winpthreads is. */
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
