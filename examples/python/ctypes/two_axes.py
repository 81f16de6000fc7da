"""Two axes on a square: start-up, SDOs, servo on, a path by CSP, servo off. Prints what ../../cpp/two_axes_12b.cpp prints."""

import ecm

SIDE = 400000  # counts
SPEED_LIMIT = 2000  # counts a cycle of 1 ms
ACCELERATION = 40  # counts a cycle, every cycle


def move_by(board, target, axis, distance):
    """Moves one axis, the other one stands; gives the cycles."""
    direction = -1 if distance < 0 else 1
    remaining, speed, cycles = abs(distance), 0, 0
    while remaining > 0:
        speed = ecm.next_speed(remaining, speed, SPEED_LIMIT, ACCELERATION)
        remaining -= speed
        target[axis] += direction * speed
        board.csp(target)
        cycles += 1
    return cycles


def main():
    with ecm.Ecm(2, ecm.DRIVE) as board:
        board.start_up()
        print(f"OP with {board.count} axes, FIFO free {board.fifo_free()}")
        for slave in board.axes():
            device_type, mode = board.sdo_read(slave, 0x1000), board.sdo_read(slave, 0x6061)
            # Deceleration of a quick stop, as an example of a parameter.
            board.sdo_write(slave, 0x6085, 20000000, size=4)
            print(f"slave {slave}: device type 0x{device_type:08X}, mode of operation {mode}")

        board.servo(on=True)
        target = [board.position(axis) for axis in board.axes()]
        for axis in board.axes():
            word, position = board.statusword(axis), board.position(axis)
            print(f"axis {axis} on, statusword ..{word & 0xFF:02X}, position {position}")

        cycles = 0
        for side, (axis, distance) in enumerate([(0, SIDE), (1, SIDE), (0, -SIDE), (1, -SIDE)], 1):
            cycles += move_by(board, target, axis, distance)
            board.settle(target)
            print(f"side {side}: at {target[0]}, {target[1]} after {cycles} cycles", flush=True)

        # The board's own count, and that of the wire.
        assert board.counters().full == board.fifo_full()
        print(f"commands lost: {board.fifo_full()}")
        board.shut_down()
    print("servos off, PreOP, closed")


ecm.run(main)
