/* Products of pairs with what every processor has. */

#include "products.h"

#define TARGET unused
#define MOST_ROWS 4
#define PRODUCTS products_plain
#define NAME "plain"
#include "lanes_plain.h"
#include "products_rows.h"
