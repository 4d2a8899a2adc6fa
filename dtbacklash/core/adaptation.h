/* What becomes of the twin's answers: the link to it, and the half-gap in force. Times are samples. */

/* What the twin answers: the half-gap that goes in force, and the estimate of it; rad, rad/s. guarded : whether its
 * standard errors are known. middle : of its buffer. */
typedef struct {
    double half_gap, gap, std, growth, growth_std;
    int64_t guarded, middle;
} GapAnswer;

/* The half-gap in force: `gap` rad at sample `since`, which grows by `growth` a sample until sample `until`.
 *
 * before : the last answer in force, if `answered`. rested : the last half-gap with which the loop came to rest.
 * new_since : sample since which another one is in force that is not judged yet, or -1. condemned : a half-gap that was
 * taken back; none like it is believed until sample `forgiven`. */
typedef struct {
    double sample_time, grows_s, most; /* s; for how long an answer's gap goes on growing, s; physical bound, rad */
    double gap, growth, rested, condemned;
    int64_t since, until, answered, new_since, forgiven;
    GapAnswer before;
} GapInForce;

/* The link: a buffer of `length` samples that fills, from sample `first` on, since `event`; and the answers that are on
 * their way for `delay` samples, (slots,) samples at which they are due, the oldest at `oldest`. */
typedef struct {
    int64_t length, delay, slots;
    int64_t filling, event, first;
    int64_t oldest, waiting;
    int64_t *due;
} TwinLink;
