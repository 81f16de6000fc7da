// Two axes on a circle: start-up, SDOs, servo on, a path by CSP, servo off. Slots of 16 bytes.
using System;
using NEXTWUSB_dotNET_16B;

static class Program
{
    const int AXES = 2;
    const int RADIUS = 60000;     // counts
    const int STEPS = 8 * RADIUS; // single counts, along x or y, of one turn
    const int SPEED_LIMIT = 1500; // steps a cycle of 1 ms
    const int ACCELERATION = 30;  // steps a cycle, every cycle
    const int WINDOW = 100;       // counts

    // A point on the circle around 0, 0, and how far it is off it: x * x + y * y - RADIUS * RADIUS.
    struct Point
    {
        public int X, Y, Off;

        // One count further, counter-clockwise: along x or along y, whatever stays closer to the circle.
        public void Step()
        {
            int dx = -Math.Sign(Y);
            int dy = Math.Sign(X);
            int offX = Off + 2 * X * dx + 1;
            int offY = Off + 2 * Y * dy + 1;
            if (dx != 0 && (dy == 0 || Math.Abs(offX) < Math.Abs(offY)))
            {
                X += dx;
                Off = offX;
            }
            else
            {
                Y += dy;
                Off = offY;
            }
        }
    }

    static void Circle()
    {
        Ecm.StartUp(AXES);
        Console.WriteLine("OP with {0} axes, FIFO free {1}", AXES, Ecm.FifoFree());

        for (int slave = 1; slave <= AXES; slave++)
        {
            uint deviceType = Ecm.SdoRead(slave, 0x1000, 0);
            uint mode = Ecm.SdoRead(slave, 0x6061, 0);
            Console.WriteLine("slave {0}: device type 0x{1:X8}, mode of operation {2}", slave, deviceType, mode);
        }

        Ecm.Servo(AXES, NEXTWUSB.SV_ON);
        int[] centre = new int[AXES];
        int[] target = new int[AXES];
        for (int axis = 0; axis < AXES; axis++)
        {
            target[axis] = centre[axis] = Ecm.Position(axis + 1);
            Console.WriteLine("axis {0} on, statusword ..{1:X2}, position {2}", axis + 1, Ecm.StatusWord(axis + 1) & 0xFF,
                target[axis]);
        }
        centre[0] -= RADIUS;

        var point = new Point { X = RADIUS };
        int done = 0, speed = 0, cycles = 0, quarter = 0;
        while (done < STEPS)
        {
            speed = Ecm.NextSpeed(STEPS - done, speed, SPEED_LIMIT, ACCELERATION);
            for (int i = 0; i < speed; i++)
                point.Step();
            done += speed;
            target[0] = centre[0] + point.X;
            target[1] = centre[1] + point.Y;
            Ecm.Csp(target, Ecm.FIFO_MARK);
            cycles++;
            if (done >= (quarter + 1) * (STEPS / 4))
            {
                quarter++;
                Console.WriteLine("quarter {0}: target {1}, {2} after {3} cycles", quarter, target[0], target[1], cycles);
            }
        }
        Ecm.Settle(target, WINDOW);
        Console.WriteLine("circle closed at {0}, {1}; commands lost: {2}", target[0], target[1], Ecm.FifoFull());

        Ecm.ShutDown(AXES);
        Console.WriteLine("servos off, PreOP, closed");
    }

    static int Main()
    {
        return Ecm.Run(Circle);
    }
}
