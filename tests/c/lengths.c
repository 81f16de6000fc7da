/* Lengths and addresses: buffers end where an unreadable page begins, so that one byte too many is a crash. */
#define _DEFAULT_SOURCE
#include "check.h"

#include <limits.h>
#ifdef _WIN32
#include <windows.h>

/* Memory before an inaccessible page: the begin of that page. */
static unsigned char *new_edge(void)
{
    size_t page = 4096;
    unsigned char *pages = (unsigned char *)VirtualAlloc(NULL, 2 * page, MEM_RESERVE, PAGE_NOACCESS);
    CHECK(pages != NULL);
    CHECK(VirtualAlloc(pages, page, MEM_COMMIT, PAGE_READWRITE) != NULL);
    return pages + page;
}
#else
#include <sys/mman.h>
#include <unistd.h>

/* Memory before an inaccessible page: the begin of that page. */
static unsigned char *new_edge(void)
{
    size_t page = (size_t)sysconf(_SC_PAGESIZE);
    unsigned char *pages =
        (unsigned char *)mmap(NULL, 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    CHECK(pages != MAP_FAILED);
    CHECK(mprotect(pages + page, page, PROT_NONE) == 0);
    return pages + page;
}
#endif

/* `length` bytes right before that page. */
static unsigned char *at_the_edge(size_t length)
{
    static unsigned char *edge;
    if (!edge) {
        edge = new_edge();
    }
    return edge - length;
}

static unsigned long long reports_read(void)
{
    ecmsk_stats stats;
    stats.size = sizeof stats;
    CHECK(ecmsk_get_stats(ecmsk_vendor_board(), &stats) == ECMSK_OK);
    return stats.read;
}

int main(void)
{
    static const unsigned long lengths[] = {1, 2, 3, 11, 12, 503, 504, 505, 511, 512, 513, 1024, 100000, UINT_MAX, ULONG_MAX};
    unsigned char whole[512];
    unsigned long long before;
    size_t i;

    CHECK(OpenECMUSB());
    for (i = 0; i < sizeof lengths / sizeof lengths[0]; i++) {
        size_t counts = lengths[i] < 512 ? lengths[i] : 512;
        unsigned char *buffer = at_the_edge(counts);

        memset(buffer, 0, counts);
        CHECK(ECMUSBWrite(buffer, lengths[i]));
        CHECK(is_filled_with(buffer, counts, 0));

        memset(at_the_edge(600), 0xA5, 600);
        CHECK(ECMUSBRead(buffer, lengths[i]));
        /* Bytes before the buffer must not be accessed either. */
        CHECK(is_filled_with(at_the_edge(600), 600 - counts, 0xA5));
        /* All bytes are written: outside OP a report begins with id 0, and no byte of it happens to be 0xA5. */
        CHECK(memchr(buffer, 0xA5, counts) == NULL);
    }

    /* Odd addresses. */
    for (i = 1; i < 16; i++) {
        unsigned char *odd = at_the_edge(512 + i) ;
        memset(odd, 0xA5, 512 + i);
        CHECK(ECMUSBRead(odd, 512));
        CHECK(memchr(odd, 0xA5, 512) == NULL);
        CHECK(is_filled_with(odd + 512, i, 0xA5));
        memset(odd, 0, 512);
        CHECK(ECMUSBWrite(odd, 512));
    }

    /* A length of 0 and a NULL read no report and transfer nothing. */
    before = reports_read();
    memset(whole, 0xA5, sizeof whole);
    CHECK(!ECMUSBRead(whole, 0));
    CHECK(last_error_has("the length is 0"));
    CHECK(!ECMUSBWrite(whole, 0));
    CHECK(last_error_has("the length is 0"));
    CHECK(!ECMUSBRead(NULL, 512));
    CHECK(last_error_has("`data` is NULL"));
    CHECK(!ECMUSBWrite(NULL, 512));
    CHECK(last_error_has("`data` is NULL"));
    CHECK(is_filled_with(whole, sizeof whole, 0xA5));
    CHECK(reports_read() == before);
    CHECK(ECMUSBRead(whole, 512));
    CHECK(reports_read() == before + 1);

    /* A short command is valid: 8 bytes hold a whole SET_STATE. */
    memset(command, 0, sizeof command);
    command[0].CMD = SET_STATE;
    command[0].Data1 = STATE_INIT;
    CHECK(ECMUSBWrite((unsigned char *)command, 8));
    for (i = 0; i < 1000 && state() != STATE_INIT; i++) {
        CHECK(read_response());
    }
    CHECK(state() == STATE_INIT);
    puts("ok");
    return 0;
}
