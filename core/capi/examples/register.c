/*
 * Registers a cloud with the C interface, on a host and on a bare Cortex-M7, and prints what came of it as
 * bits, so that both can be compared. A host: ./register policy.rgw
 */
#include "reagent.h"
#include "platform.h"

#define POINTS 200

static ReagentMemory memory; /* anywhere: static here */
static float source[POINTS][3], target[POINTS][3];

static void print_word(uint32_t word) {
    for (int shift = 28; shift >= 0; shift -= 4) {
        put_character("0123456789abcdef"[word >> shift & 15]);
    }
    put_character(' ');
}

static void print_float(float value) {
    union { float value; uint32_t bits; } pun = { value };
    print_word(pun.bits);
}

/* Points that are the same on every machine: 24 bits of a linear congruence each. */
static void draw_clouds(void) {
    uint32_t random = 1;
    for (int i = 0; i < POINTS; i++) {
        for (int axis = 0; axis < 3; axis++) {
            random = random * 1664525u + 1013904223u;
            target[i][axis] = (float)(random >> 8) / 8388608.0f - 1.0f;
            source[i][axis] = target[i][axis] + (axis == 0 ? 0.125f : 0.0f);
        }
    }
}

static int failed(ReagentStatus status) {
    put_character('!');
    print_word((uint32_t)status);
    put_character('\n');
    return 1;
}

int register_clouds(const uint8_t *weights, size_t length) {
    ReagentStatus status;
    ReagentStep step;
    ReagentResult result;

    draw_clouds();
    if ((status = reagent_init(&memory, weights, length)) != REAGENT_STATUS_OK) return failed(status);
    if ((status = reagent_set_target(&memory, target[0], POINTS)) != REAGENT_STATUS_OK) return failed(status);
    if ((status = reagent_set_source(&memory, source[0], POINTS, NULL)) != REAGENT_STATUS_OK) return failed(status);
    do {
        if ((status = reagent_step(&memory, &step)) != REAGENT_STATUS_OK) return failed(status);
        if ((status = reagent_result(&memory, &result)) != REAGENT_STATUS_OK) return failed(status);
        for (int axis = 0; axis < 3; axis++) print_word(step.translation[axis]);
        for (int axis = 0; axis < 3; axis++) print_word(step.rotation[axis]);
        for (int row = 0; row < 3; row++) {
            for (int column = 0; column < 4; column++) {
                print_float(result.target_from_source.rows[row][column]);
            }
        }
        put_character('\n');
    } while (result.steps < 10 && !result.converged);
    /* Nothing was set up in this memory: refused, not followed. */
    static ReagentMemory other;
    return reagent_step(&other, &step) == REAGENT_STATUS_NOT_INITIALISED ? 0 : 1;
}
