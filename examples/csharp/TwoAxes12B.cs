// Two axes on a square: start-up, SDOs, servo on, a path by CSP, servo off. Slots of 12 bytes.
using System;
using NEXTWUSB_dotNET;

static class Program
{
    const int AXES = 2;
    const int SIDE = 400000;      // counts
    const int SPEED_LIMIT = 2000; // counts a cycle of 1 ms
    const int ACCELERATION = 40;  // counts a cycle, every cycle
    const int WINDOW = 100;       // counts

    static readonly int[] target = new int[AXES];

    // Moves one axis by `distance` counts, faster and slower at a constant acceleration. The other one stands.
    static int MoveBy(int axis, int distance)
    {
        int direction = Math.Sign(distance);
        int remaining = Math.Abs(distance);
        int speed = 0;
        int cycles = 0;
        while (remaining > 0)
        {
            speed = Ecm.NextSpeed(remaining, speed, SPEED_LIMIT, ACCELERATION);
            remaining -= speed;
            target[axis] += direction * speed;
            Ecm.Csp(target, Ecm.FIFO_MARK);
            cycles++;
        }
        return cycles;
    }

    static void Square()
    {
        Ecm.StartUp(AXES);
        Console.WriteLine("OP with {0} axes, FIFO free {1}", AXES, Ecm.FifoFree());

        for (int slave = 1; slave <= AXES; slave++)
        {
            uint deviceType = Ecm.SdoRead(slave, 0x1000, 0);
            uint mode = Ecm.SdoRead(slave, 0x6061, 0);
            // Deceleration of a quick stop, as an example of a parameter.
            Ecm.SdoWrite(slave, 0x6085, 0, 4, 20000000);
            Console.WriteLine("slave {0}: device type 0x{1:X8}, mode of operation {2}", slave, deviceType, mode);
        }

        Ecm.Servo(AXES, NEXTWUSB.SV_ON);
        for (int axis = 1; axis <= AXES; axis++)
        {
            target[axis - 1] = Ecm.Position(axis);
            Console.WriteLine("axis {0} on, statusword ..{1:X2}, position {2}", axis, Ecm.StatusWord(axis) & 0xFF,
                Ecm.Position(axis));
        }

        int[,] path = { { 0, SIDE }, { 1, SIDE }, { 0, -SIDE }, { 1, -SIDE } };
        int cycles = 0;
        for (int i = 0; i < path.GetLength(0); i++)
        {
            cycles += MoveBy(path[i, 0], path[i, 1]);
            Ecm.Settle(target, WINDOW);
            Console.WriteLine("side {0}: at {1}, {2} after {3} cycles", i + 1, target[0], target[1], cycles);
        }
        Console.WriteLine("commands lost: {0}", Ecm.FifoFull());

        Ecm.ShutDown(AXES);
        Console.WriteLine("servos off, PreOP, closed");
    }

    static int Main()
    {
        return Ecm.Run(Square);
    }
}
