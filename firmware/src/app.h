/* The application: one loop that scans, fuses, packs and answers. */
#ifndef APP_H
#define APP_H

#include "board.h"

struct app; /* complete in app_state.h, for those who provide its memory */

/* Starts from reset: reads the stored calibration, flushes the select chain. INFO, the first packet, follows
 * when the sensors were looked for, at most 0.2 s later; nothing is received before. `board` must outlive the
 * app. */
void app_init(struct app *app, struct board *board);

/* One turn of the loop: takes received bytes, does the scan or bring-up step that is due, keeps the link
 * busy, and otherwise waits with board_wait_until for the next thing to do. Never blocks longer than
 * one scan and one wait. */
void app_poll(struct app *app);

#endif
