"""Homing: axis 1 by its home switch and index pulse, axis 2 by its limit switch; then a move by CSP; then a homing that
fails, because the drive does not know the method. Prints what ../../cpp/homing.cpp prints."""

import ecm

# Method, speed to the switch, speed to zero, acceleration, position at home.
HOMING = [(7, 300000, 30000, 10000000, 0), (17, 1500000, 50000, 10000000, -20000)]
UNKNOWN = [(36, 300000, 30000, 10000000, 0)] * 2  # there is no method 36
TRIES = 30000  # cycles: how long an axis may look for its home


def prepare(board, axis, homing):
    """Parameters and mode 6; then it waits until the statusword is that of mode 6: bit 12 means something else in CSP."""
    method, switch_speed, zero_speed, acceleration, offset = homing
    board.sdo_write(axis, 0x6098, method, size=1)
    board.sdo_write(axis, 0x6099, switch_speed, size=4, subindex=1)
    board.sdo_write(axis, 0x6099, zero_speed, size=4, subindex=2)
    board.sdo_write(axis, 0x609A, acceleration, size=4)
    board.sdo_write(axis, 0x607C, offset, size=4)
    board.sdo_write(axis, 0x6060, ecm.HOMING_MODE, size=1)
    for _ in range(100):
        mode = board.sdo_read(axis, 0x6061)
        if mode == ecm.HOMING_MODE and board.statusword(axis) & 0x3000 == 0:
            return
    raise ecm.EcmError("the drive does not enter homing mode")


def home(board, homing):
    """Homes all axes together, from one frame. False if one fails: the search of all is ended then."""
    for axis in board.axes():
        prepare(board, axis, homing[axis - 1])
    board.command(ecm.GO_HOME)
    attained, error, tries = set(), False, 0
    while len(attained) < board.count and not error:
        board.read()
        tries += 1
        error = tries > TRIES
        for axis in board.axes():
            if board.has_alarm(axis) or board.is_off(axis) or board.state() != ecm.OPERATIONAL:
                raise ecm.EcmError("an axis stops during homing")
            # Once seen is enough: with its mode back in CSP the bits of an axis mean something else.
            if board.statusword(axis) & 0x1400 == 0x1400:
                attained.add(axis)
            error = error or (axis not in attained and board.statusword(axis) & 0x2000 != 0)
    if error:
        board.command(ecm.ABORT_HOME)
    # Back to CSP, whether the board goes back by itself (firmware 1.7) or not.
    for axis in board.axes():
        board.sdo_write(axis, 0x6060, ecm.CSP_MODE, size=1)
        while board.sdo_read(axis, 0x6061) != ecm.CSP_MODE:
            pass
    return not error


def go_to_zero(board):
    """Homing has moved the coordinates: a target starts at the position of now."""
    board.read()
    target = [board.position(axis) for axis in board.axes()]
    speed = [0] * board.count
    while any(target):
        for i, at in enumerate(target):
            speed[i] = ecm.next_speed(abs(at), speed[i], 500, 10)
            target[i] += -speed[i] if at > 0 else speed[i]
        board.csp(target)
    board.settle(target)


def main():
    with ecm.Ecm(2, ecm.DRIVE) as board:
        board.start_up()
        board.servo(on=True)
        print(f"on: axis 1 at {board.position(1)}, axis 2 at {board.position(2)}")
        if not home(board, HOMING):
            raise ecm.EcmError("homing")
        print(f"home found: axis 1 at {board.position(1)}, axis 2 at {board.position(2)}")
        go_to_zero(board)
        print("both axes at 0 by CSP")
        if home(board, UNKNOWN):
            raise ecm.EcmError("a drive homes by a method that there is not")
        print("homing error (bit 13), homing ended by ABORT_HOME")
        go_to_zero(board)
        print(f"both axes still know where 0 is; commands lost: {board.fifo_full()}")
        board.shut_down()
    print("servos off, PreOP, closed")


ecm.run(main)
