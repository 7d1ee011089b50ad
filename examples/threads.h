/* threads.h: clock_fn and parallel_for_fn of sps_config: a clock, and a pool of threads. */

#ifndef EX_THREADS_H
#define EX_THREADS_H

#include "basics.h"

#include <pthread.h>
#include <time.h>
#include <unistd.h>

/* ------------------------------------------------------------------------------------------------------ the clock */

/* sps_config.clock_fn: seconds since some moment, never decreasing. */
static inline double ex_now(void *unused) {
    struct timespec now;
    (void)unused;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* -------------------------------------------------------------------------------------------- the pool of threads */

/* Threads that wait for loops and share their iterations, one loop at a time. A frame has hundreds of short loops, so a
   thread without work spins for some microseconds before it goes to sleep, and the caller never waits for a thread that
   has not joined the loop. */
typedef struct ex_pool {
    int worker_count; /* threads that share a loop, the calling thread (worker 0) included */
    struct ex_worker *workers;
    double spin_seconds;
    pthread_mutex_t mutex;
    pthread_cond_t wake, done;
    sps_task_fn task; /* this and the next two change only while `open` and `inside` are 0 */
    void *task_data;
    int count;
    int next;                      /* atomic, as are all below: the next index to run */
    int open;                      /* 1 while a loop may be joined */
    int inside;                    /* threads, except for the caller, that may be in the loop */
    int generation, quit;          /* the generation counts loops, and the end */
    int sleeping, caller_sleeping; /* who must be woken up */
} ex_pool;

typedef struct ex_worker {
    ex_pool *pool;
    pthread_t thread;
    int id;
} ex_worker;

static inline int ex_atomic_get(int *value) { return __atomic_load_n(value, __ATOMIC_SEQ_CST); }
static inline void ex_atomic_set(int *value, int to) { __atomic_store_n(value, to, __ATOMIC_SEQ_CST); }
static inline int ex_atomic_add(int *value, int by) { return __atomic_fetch_add(value, by, __ATOMIC_SEQ_CST); }

static inline void ex_spin_pause(void) {
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#endif
}

/* Spins for a short time, until the value equals `expected` (wanted = 1) or differs from it (wanted = 0). */
static inline void ex_spin(const ex_pool *pool, int *value, int expected, int wanted) {
    if (pool->spin_seconds <= 0.0) return;
    const double end = ex_now(NULL) + pool->spin_seconds;
    do
        for (int i = 0; i < 16; ++i) {
            if ((ex_atomic_get(value) == expected) == wanted) return;
            ex_spin_pause();
        }
    while (ex_now(NULL) < end);
}

static inline void ex_pool_take(ex_pool *pool, int worker) {
    for (;;) {
        const int index = ex_atomic_add(&pool->next, 1);
        if (index >= pool->count) return;
        pool->task(pool->task_data, index, worker);
    }
}

/* A thread counts itself in before it checks whether the loop is open, and the caller closes the loop before it reads
   the count. So either the caller waits for the thread, or the thread sees that the loop is closed. */
static inline void ex_pool_join(ex_pool *pool, int worker) {
    ex_atomic_add(&pool->inside, 1);
    if (ex_atomic_get(&pool->open)) ex_pool_take(pool, worker);
    if (ex_atomic_add(&pool->inside, -1) == 1 && ex_atomic_get(&pool->caller_sleeping)) {
        pthread_mutex_lock(&pool->mutex);
        pthread_cond_signal(&pool->done);
        pthread_mutex_unlock(&pool->mutex);
    }
}

static inline void *ex_worker_main(void *data) {
    const ex_worker *self = (const ex_worker *)data;
    ex_pool *pool = self->pool;
    int seen = 0;
    for (;;) {
        ex_spin(pool, &pool->generation, seen, 0);
        if (ex_atomic_get(&pool->generation) == seen) {
            pthread_mutex_lock(&pool->mutex);
            ex_atomic_add(&pool->sleeping, 1);
            while (ex_atomic_get(&pool->generation) == seen) pthread_cond_wait(&pool->wake, &pool->mutex);
            ex_atomic_add(&pool->sleeping, -1);
            pthread_mutex_unlock(&pool->mutex);
        }
        seen = ex_atomic_get(&pool->generation);
        if (ex_atomic_get(&pool->quit)) return NULL;
        ex_pool_join(pool, self->id);
    }
}

static inline void ex_pool_announce(ex_pool *pool) {
    ex_atomic_add(&pool->generation, 1);
    if (ex_atomic_get(&pool->sleeping) == 0) return;
    pthread_mutex_lock(&pool->mutex);
    pthread_cond_broadcast(&pool->wake);
    pthread_mutex_unlock(&pool->mutex);
}

static inline void ex_pool_wait(ex_pool *pool) {
    ex_spin(pool, &pool->inside, 0, 1);
    if (ex_atomic_get(&pool->inside) == 0) return;
    pthread_mutex_lock(&pool->mutex);
    ex_atomic_set(&pool->caller_sleeping, 1);
    while (ex_atomic_get(&pool->inside) != 0) pthread_cond_wait(&pool->done, &pool->mutex);
    ex_atomic_set(&pool->caller_sleeping, 0);
    pthread_mutex_unlock(&pool->mutex);
}

/* sps_config.parallel_for_fn, with the pool as parallel_user. */
static inline void ex_parallel_for(void *user, int count, sps_task_fn task, void *task_data) {
    ex_pool *pool = (ex_pool *)user;
    if (count <= 1 || pool->worker_count == 1) {
        for (int i = 0; i < count; ++i) task(task_data, i, 0);
        return;
    }
    pool->task = task, pool->task_data = task_data, pool->count = count;
    ex_atomic_set(&pool->next, 0);
    ex_atomic_set(&pool->open, 1);
    ex_pool_announce(pool);
    ex_pool_take(pool, 0);
    ex_atomic_set(&pool->open, 0);
    ex_pool_wait(pool);
}

static inline int ex_processor_count(void) {
    const long online = sysconf(_SC_NPROCESSORS_ONLN);
    return online < 1 ? 1 : online > 1024 ? 1024 : (int)online;
}

/* worker_count 0: one per processor. If the system refuses a thread, the pool is smaller. */
static inline void ex_pool_begin(ex_pool *pool, int worker_count) {
    const int processors = ex_processor_count();
    if (worker_count < 1) worker_count = processors;
    memset(pool, 0, sizeof *pool);
    pthread_mutex_init(&pool->mutex, NULL);
    pthread_cond_init(&pool->wake, NULL);
    pthread_cond_init(&pool->done, NULL);
    /* About the cost of going to sleep and waking up. With more threads than processors, spinning only gets in the way.
     */
    pool->spin_seconds = worker_count <= processors ? 20e-6 : 0.0;
    pool->workers = (ex_worker *)ex_allocate((size_t)worker_count, sizeof *pool->workers);
    for (pool->worker_count = 1; pool->worker_count < worker_count; ++pool->worker_count) {
        ex_worker *worker = pool->workers + pool->worker_count;
        worker->pool = pool;
        worker->id = pool->worker_count;
        if (pthread_create(&worker->thread, NULL, ex_worker_main, worker) != 0) break;
    }
}

static inline void ex_pool_end(ex_pool *pool) {
    ex_atomic_set(&pool->quit, 1);
    ex_pool_announce(pool);
    for (int i = 1; i < pool->worker_count; ++i) pthread_join(pool->workers[i].thread, NULL);
    free(pool->workers);
    pthread_cond_destroy(&pool->done);
    pthread_cond_destroy(&pool->wake);
    pthread_mutex_destroy(&pool->mutex);
}

#endif /* EX_THREADS_H */
