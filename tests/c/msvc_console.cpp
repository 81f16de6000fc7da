// A console program as Visual Studio begins it: on Linux it compiles with share/msvc.
#include "stdafx.h"
#include <Windows.h>
#include <conio.h>
#include <mmsystem.h>

#include "NEXTWUSBLib_12B.h"

static transData cmdData[DEF_MA_MAX];
static transData respData[DEF_MA_MAX];

int _tmain(int argc, _TCHAR *argv[])
{
    LARGE_INTEGER frequency, begin, end;
    DWORD ticks = GetTickCount();
    ULONGLONG ticks64 = GetTickCount64();
    BYTE state = 0;
    int key = 0;

    if (!OpenECMUSB()) {
        _tprintf(_T("no board for %s\n"), argv[argc - 1]);
        return 1;
    }
    timeBeginPeriod(1);
    QueryPerformanceFrequency(&frequency);
    QueryPerformanceCounter(&begin);
    ZeroMemory(cmdData, sizeof(cmdData));
    while (!_kbhit() || (key = _getch()) != 'q') {
        if (!ECMUSBWrite((unsigned char *)cmdData, sizeof(cmdData)) ||
            !ECMUSBRead((unsigned char *)respData, sizeof(respData)))
            return 1;
        state = (BYTE)respData[0].Parm;
        Sleep(1);
    }
    // What Windows gives for Enter.
    bool enter = getch() == '\r';
    Sleep(20);
    QueryPerformanceCounter(&end);
    timeEndPeriod(1);
    double seconds = (double)(end.QuadPart - begin.QuadPart) / (double)frequency.QuadPart;
    // Clocks agree, and no sleep is too short.
    bool slept = seconds >= 0.021 && GetTickCount() - ticks >= 21 && GetTickCount64() - ticks64 >= 21 &&
                 timeGetTime() - ticks >= 21;
    bool ended = _kbhit() && _getch() == EOF;
    CloseECMUSB();
    printf("state %u, %s, %s, %s\n", state, enter ? "Enter" : "no Enter", slept ? "slept" : "did not sleep",
           ended ? "end" : "no end");
    return _stricmp("Q", "q") == 0 && state != 0 ? 0 : 1;
}
