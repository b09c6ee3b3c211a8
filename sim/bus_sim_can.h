/*
 * sim/bus_sim_can.h: one CAN medium in this process: the host's socket (a hal/bus.h bus) and any number of peers.
 *
 * Model. A frame takes its true length in bits, stuffing and CRC included, at the bit rate; of all that want to send
 * when the bus falls idle the lowest id wins, and those who say the very same say it at once; everybody else hears the
 * frame at its end. A destroyed frame costs an error
 * frame, counts 8 in its sender and 1 in the others and is sent again; 128 is passive, 256 is off the bus, and coming
 * back takes 128 times 11 bits. The host's socket shows its own controller's states as error frames. Times are clock
 * ns. One thread, the owner's. The verbs are for bench/ and tests/ only.
 *
 * On a real wire (sim/can_link.h) nothing of this is modelled but who sends next and what noise destroys: the winner's
 * frame is given to the wire, and is over when the wire says it was.
 */
#ifndef BB_SIM_BUS_SIM_CAN_H
#define BB_SIM_BUS_SIM_CAN_H

#include "hal/bus.h"

#define SIM_CAN_MAILBOX 32

struct sim_can;
struct sim_can_port { /* embed it; zero but for the callbacks; detach before it goes */
	void (*frame)(struct sim_can_port *port, const struct bb_can_frame *f, int64_t at_ns);
	void (*sent)(struct sim_can_port *port, const struct bb_can_frame *f, int64_t at_ns); /* may be NULL */
	void (*back)(struct sim_can_port *port, int64_t at_ns); /* on the bus again after bus-off; may be NULL */
	bool fifo;                    /* first in first out, as a socket; else the lowest id first, as mailboxes */
	/* private */
	struct sim_can *can;
	struct sim_can_port *next;
	struct bb_can_frame box[SIM_CAN_MAILBOX];
	uint32_t n_box, cap;
	int64_t back_ns;              /* when off the bus: on again, or BB_NEVER */
	int tx_errors, rx_errors;
	int state;                    /* 0 active, 1 warning, 2 passive, 3 off */
	bool joined;                  /* says the frame under way with its sender */
	int64_t broken, muted, held;  /* faults */
};

BB_MUST_CHECK enum bb_status sim_can_create(struct bb_clock *clk, int64_t bitrate, uint64_t seed,
                                            struct sim_can **out);
void sim_can_destroy(struct sim_can *can); /* all ports are forgotten */
struct bb_can_bus *sim_can_bus(struct sim_can *can); /* the host's; its close() is the socket's, not the medium's */
struct sim_can_port *sim_can_host(struct sim_can *can);
void sim_can_attach(struct sim_can *can, struct sim_can_port *port);
void sim_can_detach(struct sim_can_port *port);
/* BB_ERR_BUSY: the queue is full; BB_ERR_LOST: not attached. */
enum bb_status sim_can_send(struct sim_can_port *port, const struct bb_can_frame *f);
/* Bits on the wire from start of frame to end of frame, without the 3 of the pause. */
int sim_can_frame_bits(const struct bb_can_frame *f);
int64_t sim_can_bits_ns(const struct sim_can *can, int64_t bits);

struct sim_can_wire {
	bool (*send)(struct sim_can_wire *wire, const struct bb_can_frame *f); /* false: not now, ask again */
};
/* Before anybody is attached. There is no host's bus then: the host is at the far end of the wire. */
void sim_can_use_wire(struct sim_can *can, struct sim_can_wire *wire);
void sim_can_wire_sent(struct sim_can *can, const struct bb_can_frame *f, int64_t at_ns);
void sim_can_wire_heard(struct sim_can *can, const struct bb_can_frame *f, int64_t at_ns);

/* Faults: on counts up, off counts down. */
void sim_can_break_tx(struct sim_can_port *port, bool on);       /* all it sends is destroyed */
void sim_can_mute(struct sim_can_port *port, bool on);           /* its stub is unplugged */
void sim_can_hold_tx(struct sim_can_port *port, bool on);        /* it never wins the bus */
void sim_can_bus_off(struct sim_can_port *port);                 /* at once */
void sim_can_error_ppm(struct sim_can *can, uint32_t ppm);       /* of frames that noise destroys */
void sim_can_link_down(struct sim_can *can, bool on);            /* the host's interface */
void sim_can_inject(struct sim_can *can, const struct bb_can_frame *f); /* from nowhere, as the next frame */
/* A node that says one frame every so often, whatever anybody else does; period 0: it stops. */
void sim_can_babble(struct sim_can *can, const struct bb_can_frame *f, int64_t period_ns);

struct sim_can_counters {
	uint64_t frames, errors, overruns; /* overruns: frames the host's socket had no room for */
	int64_t busy_ns;
};
const struct sim_can_counters *sim_can_counters(const struct sim_can *can);

#endif
