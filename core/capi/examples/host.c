/* The example on a host: weights from a file. */
#include "platform.h"
#include <stdio.h>
#include <stdlib.h>

void put_character(char character) {
    putchar(character);
}

int main(int count, char **arguments) {
    FILE *file = count == 2 ? fopen(arguments[1], "rb") : NULL;
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) {
        fprintf(stderr, "usage: %s policy.rgw\n", arguments[0]);
        return 2;
    }
    long length = ftell(file);
    uint8_t *weights = malloc((size_t)length);
    rewind(file);
    if (weights == NULL || fread(weights, 1, (size_t)length, file) != (size_t)length) {
        fprintf(stderr, "%s cannot be read\n", arguments[1]);
        return 2;
    }
    return register_clouds(weights, (size_t)length);
}
