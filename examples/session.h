/* session.h: a context that has threads, a clock and a progress line. */

#ifndef EX_SESSION_H
#define EX_SESSION_H

#include "threads.h"

/* ------------------------------------------------------------------------------------------------------- progress */

/* The progress line. It appears on terminals only, and after one second. */
typedef struct ex_progress {
    double start, shown; /* seconds */
    int terminal, visible;
} ex_progress;

static inline void ex_progress_begin(ex_progress *progress) {
    memset(progress, 0, sizeof *progress);
    progress->terminal = isatty(2);
    progress->start = progress->shown = ex_now(NULL);
}

/* sps_config.progress_fn. */
static inline int ex_progress_show(void *user, float fraction) {
    ex_progress *progress = (ex_progress *)user;
    if (!progress->terminal) return 0;
    const double now = ex_now(NULL);
    if (now - progress->start < 1.0 || now - progress->shown < 0.1) return 0;
    progress->shown = now;
    progress->visible = 1;
    fprintf(stderr, "\rrendering %3d %%, %.0f s ", (int)(100.0f * fraction), now - progress->start);
    fflush(stderr);
    return 0;
}

static inline void ex_progress_end(ex_progress *progress) {
    if (progress->visible) fputs("\r\033[K", stderr);
    progress->visible = 0;
}

/* ---------------------------------------------------------------------------------------------------- the session */

/* Must not move between begin and end: the context points into it. */
typedef struct ex_session {
    ex_pool pool;
    ex_progress progress;
    sps_context *context;
} ex_session;

/* threads 0: one per processor. */
static inline int ex_session_begin(ex_session *session, int threads, ex_error *error) {
    sps_config config;
    sps_error_info why;
    memset(&config, 0, sizeof config);
    ex_pool_begin(&session->pool, threads);
    ex_progress_begin(&session->progress);
    config.parallel_for_fn = ex_parallel_for, config.parallel_user = &session->pool;
    config.worker_count = session->pool.worker_count;
    config.progress_fn = ex_progress_show, config.progress_user = &session->progress;
    config.clock_fn = ex_now;
    session->context = sps_create(&config, &why);
    if (session->context) return 0;
    ex_pool_end(&session->pool);
    return ex_fail(error, "%s", why.sentence);
}

static inline void ex_session_end(ex_session *session) {
    ex_progress_end(&session->progress);
    sps_destroy(session->context);
    ex_pool_end(&session->pool);
}

#endif /* EX_SESSION_H */
