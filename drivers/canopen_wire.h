/*
 * drivers/canopen_wire.h: numbers of CANopen (CiA 301, 305), of error frames, and of the shutter controller's object
 * dictionary (docs/shutter-od.md). Constants only: the one thing the driver and its simulated peer share.
 */
#ifndef BB_DRIVERS_CANOPEN_WIRE_H
#define BB_DRIVERS_CANOPEN_WIRE_H

/* COB-IDs; those that end in 80 or 00 are added to a node id of 1..127. */
#define CO_NMT 0x000
#define CO_SYNC 0x080
#define CO_EMCY 0x080
#define CO_TIME 0x100
#define CO_TPDO1 0x180
#define CO_TPDO2 0x280
#define CO_SDO_REPLY 0x580
#define CO_SDO_REQUEST 0x600
#define CO_HEARTBEAT 0x700
#define CO_LSS_REPLY 0x7e4
#define CO_LSS_REQUEST 0x7e5
#define CO_NODE_MOST 127
#define CO_NODE_NONE 0xff

/* NMT commands and states */
#define CO_NMT_START 0x01
#define CO_NMT_STOP 0x02
#define CO_NMT_PREOP 0x80
#define CO_NMT_RESET_NODE 0x81
#define CO_NMT_RESET_COMM 0x82
#define CO_BOOT_UP 0x00
#define CO_STOPPED 0x04
#define CO_OPERATIONAL 0x05
#define CO_PREOP 0x7f

/* EMCY codes */
#define CO_EMCY_NONE 0x0000
#define CO_EMCY_TEMPERATURE 0x4200
#define CO_EMCY_PASSIVE 0x8120
#define CO_EMCY_HEARTBEAT 0x8130
#define CO_EMCY_BUS_OFF 0x8140
#define CO_EMCY_SYNC_LENGTH 0x8240
#define CO_EMCY_NO_LINE 0xff01 /* ours: the sync line stopped */

/* SDO abort codes */
#define CO_ABORT_TOGGLE 0x05030000u
#define CO_ABORT_TIMEOUT 0x05040000u
#define CO_ABORT_COMMAND 0x05040001u
#define CO_ABORT_MEMORY 0x05040005u
#define CO_ABORT_ACCESS 0x06010000u
#define CO_ABORT_WRITE_ONLY 0x06010001u
#define CO_ABORT_READ_ONLY 0x06010002u
#define CO_ABORT_NO_OBJECT 0x06020000u
#define CO_ABORT_LENGTH 0x06070010u
#define CO_ABORT_TOO_LONG 0x06070012u
#define CO_ABORT_TOO_SHORT 0x06070013u
#define CO_ABORT_NO_SUB 0x06090011u
#define CO_ABORT_VALUE 0x06090030u
#define CO_ABORT_TOO_HIGH 0x06090031u
#define CO_ABORT_TOO_LOW 0x06090032u
#define CO_ABORT_GENERAL 0x08000000u
#define CO_ABORT_STATE 0x08000022u

/* LSS commands */
#define CO_LSS_SWITCH 0x04
#define CO_LSS_SET_NODE 0x11
#define CO_LSS_STORE 0x17
#define CO_LSS_SELECT_VENDOR 0x40 /* 41 product, 42 revision, 43 serial */
#define CO_LSS_SELECTED 0x44
#define CO_LSS_IDENTITY 0x5a      /* 5b, 5c, 5d likewise */
#define CO_LSS_NODE 0x5e
#define CO_LSS_FASTSCAN 0x51
#define CO_LSS_FOUND 0x4f
#define CO_LSS_RESET_SCAN 0x80    /* as "bit checked" */

/* Communication objects */
#define CO_OD_TYPE 0x1000
#define CO_OD_ERROR 0x1001
#define CO_OD_HISTORY 0x1003
#define CO_OD_SYNC 0x1005
#define CO_OD_SYNC_PERIOD 0x1006
#define CO_OD_NAME 0x1008
#define CO_OD_EMCY 0x1014
#define CO_OD_CONSUMER 0x1016
#define CO_OD_PRODUCER 0x1017
#define CO_OD_IDENTITY 0x1018
#define CO_OD_OVERFLOW 0x1019
#define CO_OD_TPDO1 0x1800
#define CO_OD_TPDO2 0x1801
#define CO_OD_TPDO1_MAP 0x1a00
#define CO_OD_TPDO2_MAP 0x1a01
#define CO_SYNC_PRODUCER 0x40000000u /* bit of 1005h */
#define CO_PDO_OFF 0x80000000u       /* bit of 1800h:01 */

/* The shutter controller */
#define SHUT_TYPE 0x00530000u
#define SHUT_OD_LABEL 0x2000
#define SHUT_OD_CHAIN 0x2010    /* :01 position, :02 line delay ns, :03 tick ns */
#define SHUT_OD_PHASE 0x2020
#define SHUT_OD_FOLLOW 0x2021
#define SHUT_OD_DRIVE 0x2100    /* :01 delay ns, :02 duty ppm, :03 polarity, :04 armed, :05 watchdog ms */
#define SHUT_OD_STATUS 0x2110   /* :01 state, :02 temperature, :03 edges */
#define SHUT_OD_RECORD 0x2130
#define SHUT_LABEL_BYTES 31
#define SHUT_RECORD_BYTES 24
#define SHUT_COUNTER_MOST 240   /* even, so that the counter carries the eye */
#define SHUT_PHASE_BYTES 8      /* counter, flags, phase u32 ns, sequence, crc */
#define SHUT_FOLLOW_BYTES 6     /* counter, latency u32 ns, crc */
#define SHUT_FLAG_EYE 0x03      /* 1 left, 2 right, 0 both (open) */
#define SHUT_FLAG_LINE 0x04     /* the sync line toggles */
#define SHUT_CRC_POLYNOMIAL 0x2f
#define SHUT_CRC_START 0xff

/* Error frames: classes in the id; bits of bytes[1]; bytes[6] and [7] are the error counters. */
#define CAN_CLASS_CONTROLLER 0x004u
#define CAN_CLASS_PROTOCOL 0x008u
#define CAN_CLASS_NO_ACK 0x020u
#define CAN_CLASS_BUS_OFF 0x040u
#define CAN_CLASS_BUS_ERROR 0x080u
#define CAN_CLASS_RESTARTED 0x100u
#define CAN_CLASS_COUNTERS 0x200u
#define CAN_STATE_RX_OVERFLOW 0x01
#define CAN_STATE_TX_OVERFLOW 0x02
#define CAN_STATE_RX_WARNING 0x04
#define CAN_STATE_TX_WARNING 0x08
#define CAN_STATE_RX_PASSIVE 0x10
#define CAN_STATE_TX_PASSIVE 0x20
#define CAN_STATE_ACTIVE 0x40

#endif
