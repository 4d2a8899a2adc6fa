/* What the slaves of an FMU share: how they tell of a mistake. The macro FMI is the version, 2 or 3. */
#ifndef DTB_FMI_H
#define DTB_FMI_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { OK = 0, WRONG = 3 }; /* fmi2Error, fmi3Error */
enum { LONGEST = 512 };     /* characters of a message */

#if FMI == 2
typedef void (*Logger)(void *importer, const char *instance, int status, const char *category, const char *format, ...);
#else
typedef void (*Logger)(void *importer, int status, const char *category, const char *message);
#endif

/* Where messages go. */
typedef struct {
    Logger log;
    void *importer;
    char instance[128];
} Journal;

/* Give the importer one line on a mistake; returns the status. */
static int tell(const Journal *to, const char *format, ...)
{
    char message[LONGEST];
    va_list values;

    va_start(values, format);
    vsnprintf(message, sizeof message, format, values);
    va_end(values);
#if FMI == 2
    for (char *c = message; *c; c++) /* signs of a format, which this is */
        *c = *c == '%' || *c == '#' ? '_' : *c;
    if (to->log)
        to->log(to->importer, to->instance, WRONG, "logStatusError", message);
#else
    if (to->log)
        to->log(to->importer, WRONG, "logStatusError", message);
#endif
    return WRONG;
}

#endif
