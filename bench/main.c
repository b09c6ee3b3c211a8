#include "hal/status.h"

int main(void)
{
	return 0;
}
