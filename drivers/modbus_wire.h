/*
 * drivers/modbus_wire.h: numbers of the Modbus application protocol 1.1b3 and of the register map that `serve` puts on
 * the wire. Numbers only: driver and peer each have their own code for the bytes. Big endian, except the RTU checksum.
 */
#ifndef BB_DRIVERS_MODBUS_WIRE_H
#define BB_DRIVERS_MODBUS_WIRE_H

#define MODBUS_PDU_MOST 253
#define MODBUS_TCP_ADU_MOST 260
#define MODBUS_RTU_ADU_MOST 256
#define MODBUS_MBAP_BYTES 7         /* transaction 2, protocol 2, length 2 (unit and PDU), unit 1 */

#define MODBUS_FN_READ_COILS 0x01
#define MODBUS_FN_READ_INPUTS 0x02
#define MODBUS_FN_READ_HOLDING 0x03
#define MODBUS_FN_READ_INPUT_REGISTERS 0x04
#define MODBUS_FN_WRITE_COIL 0x05
#define MODBUS_FN_WRITE_REGISTER 0x06
#define MODBUS_FN_WRITE_COILS 0x0F
#define MODBUS_FN_WRITE_REGISTERS 0x10
#define MODBUS_FN_DEVICE_ID 0x2B    /* with MEI type 0E */
#define MODBUS_MEI_DEVICE_ID 0x0E
#define MODBUS_FN_ERROR 0x80

#define MODBUS_COIL_ON 0xFF00
#define MODBUS_COIL_OFF 0x0000

#define MODBUS_READ_BITS_MOST 2000
#define MODBUS_WRITE_BITS_MOST 1968
#define MODBUS_READ_REGISTERS_MOST 125
#define MODBUS_WRITE_REGISTERS_MOST 123

#define MODBUS_EX_FUNCTION 0x01
#define MODBUS_EX_ADDRESS 0x02
#define MODBUS_EX_VALUE 0x03
#define MODBUS_EX_FAILURE 0x04
#define MODBUS_EX_ACKNOWLEDGE 0x05
#define MODBUS_EX_BUSY 0x06
#define MODBUS_EX_NEGATIVE 0x07
#define MODBUS_EX_PARITY 0x08
#define MODBUS_EX_GATEWAY_PATH 0x0A
#define MODBUS_EX_GATEWAY_TARGET 0x0B
#define MODBUS_EX_MOST 0x0B

/*
 * Our own map, addresses as on the wire (from 0); outlet n of the strip stands n - 1 after the first.
 *   coils                the relay's command, read and write        holding registers   the same as 0 and 1
 *   discrete inputs      the contact, read back
 *   input registers      from 0 identity: 'BB', 'PW', map version, outlets; from 256 current in mA
 */
#define MODBUS_MAP_OUTLETS 0x0000
#define MODBUS_MAP_IDENTITY 0x0000
#define MODBUS_MAP_ID_0 0x4242
#define MODBUS_MAP_ID_1 0x5057
#define MODBUS_MAP_VERSION 1
#define MODBUS_MAP_IDENTITY_WORDS 4
#define MODBUS_MAP_CURRENT_MA 0x0100

#endif
