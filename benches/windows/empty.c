/* A DLL as small as one can be that stands in ours' place: what loading any DLL takes. */
#include <windows.h>

__declspec(dllexport) unsigned __stdcall OpenECMUSB(void)
{
    return 1;
}

__declspec(dllexport) void __stdcall CloseECMUSB(void)
{
}

BOOL WINAPI DllMain(HINSTANCE dll, DWORD reason, void *reserved)
{
    (void)dll;
    (void)reason;
    (void)reserved;
    return TRUE;
}
