/* Runs the command line that it is given, in a group of its own; sends Ctrl-Break to the group when standard input ends; ends
   by the code of the program. */
#include <stdio.h>
#include <string.h>
#include <windows.h>

int main(int argc, char **argv)
{
    char line[512], byte;
    STARTUPINFOA start;
    PROCESS_INFORMATION process;
    DWORD code = 0, count;

    if (argc != 2 || strlen(argv[1]) >= sizeof line)
        return 90;
    /* Events are for the processes of a console; the one that started this may have none. */
    AllocConsole();
    strcpy(line, argv[1]);
    memset(&start, 0, sizeof start);
    start.cb = sizeof start;
    start.dwFlags = STARTF_USESTDHANDLES;
    start.hStdInput = GetStdHandle(STD_INPUT_HANDLE);
    start.hStdOutput = GetStdHandle(STD_OUTPUT_HANDLE);
    start.hStdError = GetStdHandle(STD_ERROR_HANDLE);
    if (!CreateProcessA(NULL, line, NULL, NULL, TRUE, CREATE_NEW_PROCESS_GROUP, NULL, NULL, &start, &process))
        return 91;
    while (ReadFile(start.hStdInput, &byte, 1, &count, NULL) && count == 1)
        ;
    if (!GenerateConsoleCtrlEvent(CTRL_BREAK_EVENT, process.dwProcessId))
        return 92;
    if (WaitForSingleObject(process.hProcess, 60000) != WAIT_OBJECT_0) {
        TerminateProcess(process.hProcess, 93);
        WaitForSingleObject(process.hProcess, INFINITE);
    }
    GetExitCodeProcess(process.hProcess, &code);
    return (int)code;
}
