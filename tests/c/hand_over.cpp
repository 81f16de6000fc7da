// Threads that hand work to one another while others have deadlines, on the clock of --clock virtual, without a board: no
// deadline may come while a thread is on its way back from a call, or while one ends. Then what the C++ library and timers give
// to the system as times of the clock.
#include <semaphore.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <future>
#include <thread>

#define CHECK(holds)                                                              \
    do {                                                                          \
        if (!(holds)) {                                                           \
            std::fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #holds); \
            std::exit(1);                                                         \
        }                                                                         \
    } while (0)

using Clock = std::chrono::steady_clock;

static long long ms_since(Clock::time_point began)
{
    return std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - began).count();
}

static timespec in_seconds(clockid_t clock, long seconds)
{
    timespec time;
    CHECK(clock_gettime(clock, &time) == 0);
    time.tv_sec += seconds;
    return time;
}

// One thread waits without a limit and answers; the other one waits for the answer with a limit.
static int answers_too_late(int rounds)
{
    sem_t asked, answered;
    CHECK(sem_init(&asked, 0, 0) == 0 && sem_init(&answered, 0, 0) == 0);
    std::thread worker([&] {
        for (int n = 0; n < rounds; n++) {
            CHECK(sem_wait(&asked) == 0 && sem_post(&answered) == 0);
        }
    });
    int late = 0;
    for (int n = 0; n < rounds; n++) {
        timespec limit = in_seconds(CLOCK_REALTIME, 10);
        CHECK(sem_post(&asked) == 0);
        if (sem_timedwait(&answered, &limit) != 0) {
            CHECK(errno == ETIMEDOUT && sem_wait(&answered) == 0);
            late++;
        }
    }
    worker.join();
    return late;
}

// Threads that sleep 1 ms, beside one that sleeps much longer.
static int joins_too_late(int rounds)
{
    std::atomic<bool> ends{false};
    std::thread other([&] {
        while (!ends) {
            sleep(10);
        }
    });
    int late = 0;
    for (int n = 0; n < rounds; n++) {
        auto began = Clock::now();
        std::thread([] { usleep(1000); }).join();
        late += ms_since(began) > 5000;
    }
    ends = true;
    other.join();
    return late;
}

int main()
{
    std::printf("answers: %d too late\n", answers_too_late(20000));
    std::printf("joins: %d too late\n", joins_too_late(2000));

    CHECK(sleep(60) == 0);
    std::promise<int> promise;
    auto future = promise.get_future();
    auto began = Clock::now();
    CHECK(future.wait_for(std::chrono::milliseconds(100)) == std::future_status::timeout);
    std::printf("a future that does not come: %lld ms\n", ms_since(began));
    began = Clock::now();
    std::thread sets([&] {
        usleep(50000);
        promise.set_value(7);
    });
    CHECK(future.wait_for(std::chrono::seconds(1000)) == std::future_status::ready && future.get() == 7);
    std::printf("one that comes: %lld ms\n", ms_since(began));
    sets.join();

    // The time that is left is real: less than the minute that has passed on the clock alone and the one to come.
    for (clockid_t clock : {CLOCK_MONOTONIC, CLOCK_REALTIME}) {
        int timer = timerfd_create(clock, 0);
        itimerspec time = {{0, 0}, in_seconds(clock, 60)}, left;
        CHECK(timer >= 0 && timerfd_settime(timer, TFD_TIMER_ABSTIME, &time, nullptr) == 0);
        CHECK(timerfd_gettime(timer, &left) == 0);
        std::printf("a timer: %s\n", left.it_value.tv_sec <= 60 ? "within the minute" : "too late");
        close(timer);
    }
    std::puts("ok");
    return 0;
}
