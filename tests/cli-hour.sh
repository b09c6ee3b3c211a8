#!/bin/sh
# The short form of "make bench-hour": a virtual minute of the deck's displays, shutters and links, twice.
. tests/cli.sh.inc

check "a minute of 416 displays: one hash, and CPU time for 60 of them in a minute" tests/hour.sh 60 1
finish
