/*
 * Registers pairs of clouds from a file, every second one in slices, every second two of them on grids of 16-bit
 * codes, and prints each step as bits: ./pairs policy.rgw clouds. The file holds words of 32 bits, little-endian: the number of pairs; for each, the
 * points of source and target, and the coordinates of both, as floats.
 */
#include "reagent.h"
#include <stdio.h>
#include <stdlib.h>

static void *read_file(const char *path, size_t *length) {
    FILE *file = fopen(path, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) {
        fprintf(stderr, "%s cannot be read\n", path);
        exit(2);
    }
    *length = (size_t)ftell(file);
    void *bytes = malloc(*length);
    rewind(file);
    if (bytes == NULL || fread(bytes, 1, *length, file) != *length) {
        fprintf(stderr, "%s cannot be read\n", path);
        exit(2);
    }
    fclose(file);
    return bytes;
}

static void check(ReagentStatus status) {
    if (status != REAGENT_STATUS_OK) {
        fprintf(stderr, "status %d\n", (int)status);
        exit(1);
    }
}

/* Puts a cloud on the finest grid of it. */
static int16_t *codes_of(const float *xyz, size_t points, ReagentGrid *grid) {
    int16_t *codes = malloc(points * 3 * sizeof *codes);
    if (codes == NULL) exit(2);
    check(reagent_grid_of(xyz, points, grid));
    check(reagent_encode(grid, xyz, points, codes));
    return codes;
}

static void print_step(const ReagentStep *step, const ReagentResult *result) {
    for (int axis = 0; axis < 3; axis++) printf("%08x ", step->translation[axis]);
    for (int axis = 0; axis < 3; axis++) printf("%08x ", step->rotation[axis]);
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 4; column++) {
            union { float value; uint32_t bits; } pun = { result->target_from_source.rows[row][column] };
            printf("%08x ", pun.bits);
        }
    }
    putchar('\n');
}

int main(int count, char **arguments) {
    if (count != 3) {
        fprintf(stderr, "usage: %s policy.rgw clouds\n", arguments[0]);
        return 2;
    }
    static ReagentMemory memory;
    size_t length, bytes;
    const uint8_t *weights = read_file(arguments[1], &length);
    const uint32_t *words = read_file(arguments[2], &bytes);
    check(reagent_init(&memory, weights, length));
    const uint32_t pairs = *words++;
    for (uint32_t pair = 0; pair < pairs; pair++) {
        const uint32_t points = *words++, target_points = *words++;
        const float *source = (const float *)words, *target = source + 3 * points;
        words += 3 * (points + target_points);
        ReagentStep step;
        ReagentResult result;
        const bool sliced = pair % 2 == 1, on_grid = pair % 4 >= 2;
        int16_t *source_codes = NULL, *target_codes = NULL;
        if (on_grid) {
            ReagentGrid source_grid, target_grid;
            source_codes = codes_of(source, points, &source_grid);
            target_codes = codes_of(target, target_points, &target_grid);
            check(reagent_set_target_on_grid(&memory, &target_grid, target_codes, target_points));
            check((sliced ? reagent_begin_on_grid : reagent_set_source_on_grid)(
                &memory, &source_grid, source_codes, points, NULL));
        } else {
            check(reagent_set_target(&memory, target, target_points));
            check((sliced ? reagent_begin : reagent_set_source)(&memory, source, points, NULL));
        }
        do {
            bool stepped = !sliced;
            if (stepped) {
                check(reagent_step(&memory, &step));
            }
            while (!stepped) check(reagent_advance(&memory, 100, &step, &stepped));
            check(reagent_result(&memory, &result));
            print_step(&step, &result);
        } while (result.steps < 10 && !result.converged);
        free(source_codes);
        free(target_codes);
    }
    return 0;
}
