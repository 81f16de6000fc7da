#include <stdio.h>

#include "NEXTWUSBLib_12B.h"

static transData cmd[DEF_MA_MAX], resp[DEF_MA_MAX];

int main(void)
{
	if (!OpenECMUSB())
		return 1;
	cmd[0].CMD = SET_STATE;
	cmd[0].Data1 = STATE_PRE_OP;
	if (!ECMUSBWrite((unsigned char *)cmd, sizeof(cmd)))
		return 2;
	do {
		if (!ECMUSBRead((unsigned char *)resp, sizeof(resp)))
			return 3;
	} while ((resp[0].Parm & 0xFF) != STATE_PRE_OP);
	puts("PreOP");
	CloseECMUSB();
	return 0;
}
