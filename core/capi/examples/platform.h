/* What the example needs of a machine. */
#include <stddef.h>
#include <stdint.h>

void put_character(char character);
int register_clouds(const uint8_t *weights, size_t length);
