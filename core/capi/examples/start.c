/*
 * Registers two clouds and tells how sure the pose is. The library with a policy inside, then this program:
 *
 *     core/capi/install /tmp/reagent pretrained-compact
 *     export PKG_CONFIG_PATH=/tmp/reagent/lib/pkgconfig
 *     cc core/capi/examples/start.c $(pkg-config --cflags --libs reagent) -o start && ./start
 */
#include <reagent.h>
#include <stdio.h>
#include <stdlib.h>

#define POINTS 600

/* All memory is yours. Static, since it is too much for most stacks. */
static ReagentMemory memory;
static ReagentWorkspace workspace;
static float model[POINTS][3], seen[POINTS][3];

static void check(ReagentStatus status) {
    if (status != REAGENT_STATUS_OK) {
        fprintf(stderr, "%s\n", reagent_status_text(status));
        exit(1);
    }
}

/* An angle bracket in millimetres; the sensor sees it turned by 90 - 73.74 degrees about z and 5 mm to the side. */
static void draw_clouds(void) {
    for (int i = 0; i < POINTS; i++) {
        const float u = 2.0f * (float)(i % 30), v = 2.0f * (float)(i / 30);
        const float x = u, y = v < 20 ? v : 0, z = v < 20 ? 0 : v - 20;
        model[i][0] = x, model[i][1] = y, model[i][2] = z;
        seen[i][0] = 0.96f * x - 0.28f * y + 5, seen[i][1] = 0.28f * x + 0.96f * y, seen[i][2] = z;
    }
}

int main(void) {
    if (reagent_version() != REAGENT_VERSION) {
        fprintf(stderr, "header and library are of different versions\n");
        return 1;
    }
    draw_clouds();
    size_t length;
    const uint8_t *weights = reagent_pretrained_compact(&length);
    check(reagent_init(&memory, weights, length));

    /* The best pose, from the identity; what is known better is set in the task. */
    const ReagentTask task = reagent_task();
    ReagentAnswer answer;
    check(reagent_register(&memory, &workspace, seen[0], POINTS, model[0], POINTS, &task, &answer));
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 4; column++) printf("%9.4f", answer.target_from_source.rows[row][column]);
        putchar('\n');
    }
    printf("%s: right with a probability of %.3f; %.0f %% of the points lie on the model, %.3g mm off it\n",
           answer.verdict == REAGENT_VERDICT_CONVERGED ? "converged" : "not to be acted on", answer.probability,
           100 * answer.overlap, answer.inlier_rmse);
    if (answer.axis_is_open || answer.slide_is_open || answer.others > 0) puts("other poses fit as well");
    return 0;
}
