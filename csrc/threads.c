#if !defined(_WIN32) && !defined(_POSIX_C_SOURCE)
#define _POSIX_C_SOURCE 200809L
#endif

#include "threads.h"
#include "memory.h"

#include <string.h>

#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#include <windows.h>
typedef CRITICAL_SECTION native_mutex;
typedef CONDITION_VARIABLE native_condition;
typedef HANDLE native_thread;
#define THREAD_RESULT DWORD WINAPI
typedef LPTHREAD_START_ROUTINE native_main;
#else
#include <pthread.h>
#include <time.h>
#include <unistd.h>
typedef pthread_mutex_t native_mutex;
typedef pthread_cond_t native_condition;
typedef pthread_t native_thread;
#define THREAD_RESULT void *
typedef void *(*native_main)(void *);
#endif

/* ---- the system's primitives ------------------------------------------- */

static int native_mutex_init(native_mutex *m)
{
#ifdef _WIN32
    InitializeCriticalSection(m);
    return 1;
#else
    return pthread_mutex_init(m, NULL) == 0;
#endif
}

static void native_mutex_destroy(native_mutex *m)
{
#ifdef _WIN32
    DeleteCriticalSection(m);
#else
    (void)pthread_mutex_destroy(m);
#endif
}

static void native_lock(native_mutex *m)
{
#ifdef _WIN32
    EnterCriticalSection(m);
#else
    (void)pthread_mutex_lock(m);
#endif
}

static void native_unlock(native_mutex *m)
{
#ifdef _WIN32
    LeaveCriticalSection(m);
#else
    (void)pthread_mutex_unlock(m);
#endif
}

static int native_condition_init(native_condition *c)
{
#ifdef _WIN32
    InitializeConditionVariable(c);
    return 1;
#else
    return pthread_cond_init(c, NULL) == 0;
#endif
}

static void native_condition_destroy(native_condition *c)
{
#ifdef _WIN32
    (void)c;
#else
    (void)pthread_cond_destroy(c);
#endif
}

static void native_signal(native_condition *c)
{
#ifdef _WIN32
    WakeConditionVariable(c);
#else
    (void)pthread_cond_signal(c);
#endif
}

/* Waits for a signal, 20 ms at most; the mutex is held. */
static void native_wait(native_condition *c, native_mutex *m)
{
#ifdef _WIN32
    (void)SleepConditionVariableCS(c, m, 20);
#else
    struct timespec when;
    (void)clock_gettime(CLOCK_REALTIME, &when);
    when.tv_nsec += 20000000L;
    if (when.tv_nsec >= 1000000000L) {
        when.tv_nsec -= 1000000000L;
        when.tv_sec += 1;
    }
    (void)pthread_cond_timedwait(c, m, &when);
#endif
}

static int native_start(native_thread *thread, native_main run, void *argument)
{
#ifdef _WIN32
    *thread = CreateThread(NULL, 0, run, argument, 0, NULL);
    return *thread != NULL;
#else
    return pthread_create(thread, NULL, run, argument) == 0;
#endif
}

static void native_join(native_thread thread)
{
#ifdef _WIN32
    (void)WaitForSingleObject(thread, INFINITE);
    (void)CloseHandle(thread);
#else
    (void)pthread_join(thread, NULL);
#endif
}

int vocc_processor_count(void)
{
    long n;
#ifdef _WIN32
    SYSTEM_INFO info;
    GetSystemInfo(&info);
    n = (long)info.dwNumberOfProcessors;
#else
    n = sysconf(_SC_NPROCESSORS_ONLN);
#endif
    if (n < 1)
        return 1;
    return n > VOCC_MAX_THREADS ? VOCC_MAX_THREADS : (int)n;
}

double vocc_seconds(void)
{
#ifdef _WIN32
    LARGE_INTEGER now, rate;
    QueryPerformanceCounter(&now);
    QueryPerformanceFrequency(&rate);
    return (double)now.QuadPart / (double)rate.QuadPart;
#else
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
#endif
}

/* ---- locks -------------------------------------------------------------- */

struct vocc_mutex {
    native_mutex native;
};

vocc_mutex *vocc_mutex_create(const vocc_allocator *allocator)
{
    vocc_mutex *mutex = vocc_allocate(allocator, 1, sizeof *mutex);
    if (mutex && !native_mutex_init(&mutex->native)) {
        vocc_release(allocator, mutex);
        mutex = NULL;
    }
    return mutex;
}

void vocc_mutex_free(const vocc_allocator *allocator, vocc_mutex *mutex)
{
    if (mutex) {
        native_mutex_destroy(&mutex->native);
        vocc_release(allocator, mutex);
    }
}

void vocc_mutex_lock(vocc_mutex *mutex)
{
    native_lock(&mutex->native);
}

void vocc_mutex_unlock(vocc_mutex *mutex)
{
    native_unlock(&mutex->native);
}

/* ---- progress ----------------------------------------------------------- */

void vocc_ticker_init(vocc_ticker *ticker, vocc_progress_fn call, void *user)
{
    ticker->call = call;
    ticker->user = user;
    ticker->from = 0.0;
    ticker->to = 1.0;
    ticker->last = 0.0;
    ticker->time = 0.0;
    ticker->stopped = 0;
}

void vocc_ticker_stage(vocc_ticker *ticker, double from, double to)
{
    ticker->from = from;
    ticker->to = to;
}

int vocc_tick(vocc_ticker *ticker, double fraction)
{
    double now, told = ticker->from + (ticker->to - ticker->from) * fraction;
    if (!ticker->call || ticker->stopped)
        return ticker->stopped;
    if (told > 1.0)
        told = 1.0;
    now = vocc_seconds();
    /* 5 ms apart: at most 200 calls a second; the last one always. */
    if (now - ticker->time < 0.005 && told < 1.0)
        return 0;
    ticker->time = now;
    if (told > ticker->last)
        ticker->last = told;
    ticker->stopped = ticker->call(ticker->user, ticker->last) != 0;
    return ticker->stopped;
}

/* ---- jobs --------------------------------------------------------------- */

struct vocc_jobs {
    native_mutex mutex;
    native_condition idle;
    size_t next, done, count;
    int running; /* workers other than 0 that have not left */
    int stop;
    vocc_status status;
    size_t failed; /* the job that `status` is of */
    vocc_job_fn run;
    void *context;
    vocc_ticker *ticker;
};

typedef struct worker_start {
    vocc_jobs *jobs;
    int worker;
} worker_start;

static void stop_with(vocc_jobs *jobs, vocc_status status, size_t job)
{
    native_lock(&jobs->mutex);
    /* A job that only noticed the stop does not hide why it came. */
    if (jobs->status == VOCC_OK ||
        (status != VOCC_ERROR_CANCELLED && job < jobs->failed)) {
        jobs->status = status;
        jobs->failed = job;
    }
    jobs->stop = 1;
    native_unlock(&jobs->mutex);
}

/* Reports from worker 0; asks the run to stop if the user says so. */
static void report(vocc_jobs *jobs, size_t done)
{
    if (vocc_tick(jobs->ticker, (double)done / (double)jobs->count))
        stop_with(jobs, VOCC_ERROR_CANCELLED, jobs->count);
}

int vocc_jobs_poll(vocc_jobs *jobs, int worker)
{
    int stop;
    size_t done;
    native_lock(&jobs->mutex);
    stop = jobs->stop;
    done = jobs->done;
    native_unlock(&jobs->mutex);
    if (!stop && worker == 0 && jobs->ticker->call) {
        report(jobs, done);
        native_lock(&jobs->mutex);
        stop = jobs->stop;
        native_unlock(&jobs->mutex);
    }
    return stop;
}

static void work(vocc_jobs *jobs, int worker)
{
    for (;;) {
        size_t job = 0, done;
        int stop;
        vocc_status status;
        native_lock(&jobs->mutex);
        stop = jobs->stop || jobs->next == jobs->count;
        if (!stop)
            job = jobs->next++;
        native_unlock(&jobs->mutex);
        if (stop)
            break;
        status = jobs->run(jobs->context, job, worker, jobs);
        if (status != VOCC_OK)
            stop_with(jobs, status, job);
        native_lock(&jobs->mutex);
        done = ++jobs->done;
        native_unlock(&jobs->mutex);
        if (worker == 0)
            report(jobs, done);
    }
}

static THREAD_RESULT worker_main(void *argument)
{
    worker_start *start = argument;
    vocc_jobs *jobs = start->jobs;
    work(jobs, start->worker);
    native_lock(&jobs->mutex);
    jobs->running--;
    native_signal(&jobs->idle);
    native_unlock(&jobs->mutex);
    return 0;
}

vocc_status vocc_jobs_run(const vocc_allocator *allocator, int threads,
                          size_t count, vocc_job_fn run, void *context,
                          vocc_ticker *ticker)
{
    vocc_jobs jobs;
    native_thread *handles = NULL;
    worker_start *starts = NULL;
    int started = 0, i;

    if (count == 0)
        return VOCC_OK;
    memset(&jobs, 0, sizeof jobs);
    jobs.count = count;
    jobs.run = run;
    jobs.context = context;
    jobs.ticker = ticker;
    if ((size_t)threads > count)
        threads = (int)count;
    if (!native_mutex_init(&jobs.mutex))
        return VOCC_ERROR_THREAD;
    if (!native_condition_init(&jobs.idle)) {
        native_mutex_destroy(&jobs.mutex);
        return VOCC_ERROR_THREAD;
    }
    if (threads > 1) {
        handles = vocc_allocate(allocator, (size_t)threads, sizeof *handles);
        starts = vocc_allocate(allocator, (size_t)threads, sizeof *starts);
        if (!handles || !starts) {
            jobs.status = VOCC_ERROR_OUT_OF_MEMORY;
            jobs.stop = 1;
            threads = 1;
        }
    }
    for (i = 1; i < threads; i++) {
        starts[i].jobs = &jobs;
        starts[i].worker = i;
        native_lock(&jobs.mutex);
        jobs.running++;
        native_unlock(&jobs.mutex);
        if (!native_start(&handles[i], worker_main, &starts[i])) {
            native_lock(&jobs.mutex);
            jobs.running--;
            native_unlock(&jobs.mutex);
            break;
        }
        started++;
    }
    work(&jobs, 0);
    /* Keep reporting (and listening for a stop) while others finish. */
    native_lock(&jobs.mutex);
    while (jobs.running > 0) {
        size_t done;
        native_wait(&jobs.idle, &jobs.mutex);
        done = jobs.done;
        native_unlock(&jobs.mutex);
        report(&jobs, done);
        native_lock(&jobs.mutex);
    }
    native_unlock(&jobs.mutex);
    for (i = 1; i <= started; i++)
        native_join(handles[i]);
    vocc_release(allocator, handles);
    vocc_release(allocator, starts);
    native_condition_destroy(&jobs.idle);
    native_mutex_destroy(&jobs.mutex);
    return jobs.status;
}

/* ---- aside -------------------------------------------------------------- */

struct vocc_aside {
    native_mutex mutex;
    native_condition ended;
    native_thread thread;
    vocc_aside_fn run;
    void *context;
    vocc_status status;
    int stop, over;
};

static int asked_to_stop(void *user, double fraction)
{
    vocc_aside *aside = user;
    int stop;
    (void)fraction;
    native_lock(&aside->mutex);
    stop = aside->stop;
    native_unlock(&aside->mutex);
    return stop;
}

static THREAD_RESULT aside_main(void *argument)
{
    vocc_aside *aside = argument;
    vocc_ticker ticker;
    vocc_ticker_init(&ticker, asked_to_stop, aside);
    aside->status = aside->run(aside->context, &ticker);
    native_lock(&aside->mutex);
    aside->over = 1;
    native_signal(&aside->ended);
    native_unlock(&aside->mutex);
    return 0;
}

vocc_status vocc_aside_begin(const vocc_allocator *allocator, vocc_aside_fn run,
                             void *context, vocc_aside **aside)
{
    vocc_aside *a = *aside = vocc_allocate(allocator, 1, sizeof *a);
    if (!a)
        return VOCC_ERROR_OUT_OF_MEMORY;
    memset(a, 0, sizeof *a);
    a->run = run;
    a->context = context;
    if (native_mutex_init(&a->mutex)) {
        if (native_condition_init(&a->ended)) {
            if (native_start(&a->thread, aside_main, a))
                return VOCC_OK;
            native_condition_destroy(&a->ended);
        }
        native_mutex_destroy(&a->mutex);
    }
    vocc_release(allocator, a);
    *aside = NULL;
    return VOCC_OK;
}

vocc_status vocc_aside_end(const vocc_allocator *allocator, vocc_aside *aside,
                           int stop, vocc_ticker *ticker)
{
    vocc_status status;
    native_lock(&aside->mutex);
    aside->stop = stop;
    while (!aside->over) {
        native_wait(&aside->ended, &aside->mutex);
        native_unlock(&aside->mutex);
        stop |= vocc_tick(ticker, 0.0);
        native_lock(&aside->mutex);
        aside->stop = stop;
    }
    native_unlock(&aside->mutex);
    native_join(aside->thread);
    status = aside->status;
    native_condition_destroy(&aside->ended);
    native_mutex_destroy(&aside->mutex);
    vocc_release(allocator, aside);
    return status;
}
