/* A caller with other floating-point settings: unmasked exceptions (Delphi, C++Builder), another rounding and
 * precision (graphics libraries). After each call the caller's state is unchanged. Prints a sum of all answers of the
 * board. Arguments: the states of SSE and of x87, hexadecimal. */
#include "loaded.h"

enum { SLOTS = 42, CYCLES = 400 };

struct slot {
    unsigned short cmd, parm;
    unsigned data1, data2;
};
static struct slot command[SLOTS], response[SLOTS];
static unsigned odd_sse, odd_x87;

static void set(unsigned sse, unsigned short x87)
{
    __asm__ volatile("ldmxcsr %0\n\tfldcw %1" : : "m"(sse), "m"(x87));
}

static void look(void)
{
    unsigned sse;
    unsigned short x87;
    __asm__ volatile("stmxcsr %0\n\tfnstcw %1" : "=m"(sse), "=m"(x87));
    CHECK((sse & ~0x3Fu) == odd_sse && x87 == odd_x87);
}

static void exchange(void)
{
    CHECK(write_board((unsigned char *)command, sizeof command) == 1);
    look();
    CHECK(read_board((unsigned char *)response, sizeof response) == 1);
    look();
}

static void master(unsigned short cmd, unsigned short parm, unsigned data1, unsigned data2)
{
    memset(command, 0, sizeof command);
    command[0].cmd = cmd;
    command[0].parm = parm;
    command[0].data1 = data1;
    command[0].data2 = data2;
    exchange();
    memset(command, 0, sizeof command);
}

static void go_to(unsigned state)
{
    int i;
    master(1, 0, state, 0);
    for (i = 0; i < 5000 && (response[0].parm & 0xFF) != state; i++) {
        exchange();
    }
    CHECK((response[0].parm & 0xFF) == state);
}

/* Moves a drive on a path; a sum of all answers. */
static unsigned move(unsigned sse, unsigned short x87)
{
    unsigned sum = 17;
    int i;
    odd_sse = sse;
    odd_x87 = x87;
    set(sse, x87);
    CHECK(open_board() == 1);
    look();
    go_to(2);
    master(2, 0, 0xFFFFFFF0u, 0);
    for (i = 1; i < 5; i++) {
        master(2, (unsigned short)i, 0xFFFFFFFFu, 0);
    }
    master(3, 0, 1000, 0xFFFF);
    command[1].cmd = 6;
    command[1].data1 = 8;
    command[1].data2 = 1;
    exchange();
    go_to(8);
    command[1].cmd = 0x11;
    exchange();
    command[1].cmd = 0;
    for (i = 0; i < 2000 && (response[1].parm & 0xFF) != 0x37; i++) {
        exchange();
    }
    CHECK((response[1].parm & 0xFF) == 0x37);
    for (i = 0; i < CYCLES; i++) {
        size_t byte;
        command[1].cmd = 0x15;
        command[1].data1 = (unsigned)(i * i / 7);
        exchange();
        for (byte = 0; byte < sizeof response; byte++) {
            sum = sum * 31 + ((unsigned char *)response)[byte];
        }
    }
    close_board();
    look();
    set(0x1F80, 0x037F);
    return sum;
}

int main(int count, char **arguments)
{
    CHECK(count == 3);
    load(DLL);
    printf("%08X\n", move(strtoul(arguments[1], NULL, 16), (unsigned short)strtoul(arguments[2], NULL, 16)));
    fflush(stdout);
    return 0;
}
