/* bench/report/cells.c: cells of a table: texts are escaped, numbers stand right, what is not known is a dash. */
#include "bench/report/html.h"

#include "bench/file.h"

#include <math.h>
#include <string.h>

void bb_cell(FILE *f, const char *class_name, const char *text)
{
	if (class_name)
		fprintf(f, "<td class=\"%s\">", class_name);
	else
		fputs("<td>", f);
	bb_put_markup(f, text);
	fputs("</td>", f);
}

void bb_cell_number(FILE *f, double v)
{
	char text[32];

	bb_cell(f, "n", isnan(v) ? "\xE2\x80\x93" : bb_text_number(text, sizeof(text), v));
}

void bb_cell_count(FILE *f, uint64_t v)
{
	char plain[24], grouped[40];
	size_t k = 0;

	bb_text_format(plain, sizeof(plain), "%llu", (unsigned long long)v);
	for (size_t i = 0, n = strlen(plain); i < n; i++) {
		if (i && (n - i) % 3 == 0) { /* U+2009, a thin space; cells do not break */
			memcpy(grouped + k, "\xE2\x80\x89", 3);
			k += 3;
		}
		grouped[k++] = plain[i];
	}
	grouped[k] = '\0';
	bb_cell(f, "n", grouped);
}

/* ms with microseconds: one column, one number of decimals. */
void bb_cell_ms(FILE *f, double v)
{
	char text[32] = "\xE2\x80\x93";

	if (!isnan(v))
		bb_text_format(text, sizeof(text), "%.3f", v);
	bb_cell(f, "n", text);
}
