/* Tiles with what every processor has. */

#define TILES tiles_plain
#include "composite_tiles.h"
