// SPDX-License-Identifier: GPL-2.0 OR MIT
/* A board on SPI for a machine that has none, for the wire tests alone: an SPI controller with one device behind it
   (/dev/spidev0.0), two GPIO lines (BUSY, which the board drives, and RESET, which the host drives), and a file by
   which one process is the board.

   /dev/ecm-board, read: one event each, struct event and, of an exchange, the bytes that came from the host.
   /dev/ecm-board, write: ANSWER and as many bytes, which end the exchange; or LINE_BUSY and the line's level.
   Written for the kernel of Debian 12 (6.1). */
#include <linux/delay.h>
#include <linux/gpio/driver.h>
#include <linux/interrupt.h>
#include <linux/irq.h>
#include <linux/irqdomain.h>
#include <linux/kfifo.h>
#include <linux/ktime.h>
#include <linux/math64.h>
#include <linux/miscdevice.h>
#include <linux/module.h>
#include <linux/mutex.h>
#include <linux/platform_device.h>
#include <linux/poll.h>
#include <linux/spi/spi.h>
#include <linux/uaccess.h>

/* How long a host waits for the board: the guest's host may be busy. */
enum { EXCHANGE_MAX = 4096, MAX_HZ = 50000000, PATIENCE_S = 60 };
enum { BUSY, RESET, LINES };
/* Kinds of events. */
enum { EXCHANGE = 1, RESET_LEVEL = 2 };
/* Kinds of writes. */
enum { ANSWER = 1, BUSY_LEVEL = 2 };

struct event {
    u32 kind;
    u32 value; /* bytes of the exchange, or level of the line */
    u32 speed_hz;
    u8 mode;
    u8 bits;
    u16 transfers;
    u64 at_ns; /* CLOCK_MONOTONIC */
};

static DEFINE_MUTEX(lock);
static DECLARE_WAIT_QUEUE_HEAD(changed);
static bool played; /* a process acts as the board */

/* The exchange: offered by the host, taken by the board, answered by the board. */
static enum { NONE, OFFERED, TAKEN, ANSWERED } exchange;
static struct event exchanged;
static u8 from_host[EXCHANGE_MAX], to_host[EXCHANGE_MAX];

static bool level[LINES] = {false, true};
static DEFINE_KFIFO(resets, struct event, 64);
static unsigned int edges; /* IRQ_TYPE_EDGE_*: those requested of BUSY */
static bool masked = true;

/* SPI ------------------------------------------------------------------------------------------------------------- */

/* One exchange under one chip select; `to_host` has the answer. Without a board MISO is pulled up. It takes at least
   as long as on wires. */
static int exchange_with_board(void)
{
    u32 bits = exchanged.value * 8;
    int error = 0;
    long left;

    exchanged.kind = EXCHANGE;
    exchanged.at_ns = ktime_get_ns();
    fsleep(div_u64((u64)bits * USEC_PER_SEC, exchanged.speed_hz));
    mutex_lock(&lock);
    memset(to_host, 0xff, exchanged.value);
    if (played) {
        exchange = OFFERED;
        mutex_unlock(&lock);
        wake_up_all(&changed);
        left = wait_event_killable_timeout(changed, READ_ONCE(exchange) == ANSWERED || !READ_ONCE(played),
                                           PATIENCE_S * HZ);
        mutex_lock(&lock);
        if (left <= 0)
            error = left ? -EINTR : -ETIMEDOUT;
    }
    exchange = NONE;
    mutex_unlock(&lock);
    return error;
}

/* The transfers from `first` to `last` are one exchange. */
static int exchange_transfers(struct spi_message *message, struct spi_transfer *first, struct spi_transfer *last)
{
    struct spi_transfer *transfer = first;
    unsigned int at = 0;
    int error;

    exchanged = (struct event){
        .speed_hz = first->speed_hz,
        .mode = message->spi->mode,
        .bits = first->bits_per_word,
    };
    for (;; transfer = list_next_entry(transfer, transfer_list)) {
        if (at + transfer->len > EXCHANGE_MAX)
            return -EMSGSIZE;
        if (transfer->tx_buf)
            memcpy(from_host + at, transfer->tx_buf, transfer->len);
        else
            memset(from_host + at, 0, transfer->len);
        at += transfer->len;
        exchanged.transfers++;
        if (transfer == last)
            break;
    }
    exchanged.value = at;
    error = exchange_with_board();
    if (error)
        return error;
    for (at = 0, transfer = first;; transfer = list_next_entry(transfer, transfer_list)) {
        if (transfer->rx_buf)
            memcpy(transfer->rx_buf, to_host + at, transfer->len);
        at += transfer->len;
        if (transfer == last)
            break;
    }
    message->actual_length += at;
    return 0;
}

static int transfer_message(struct spi_controller *controller, struct spi_message *message)
{
    struct spi_transfer *transfer, *first = NULL;
    int error = 0;

    message->actual_length = 0;
    list_for_each_entry(transfer, &message->transfers, transfer_list) {
        if (!first)
            first = transfer;
        if (!transfer->cs_change && !list_is_last(&transfer->transfer_list, &message->transfers))
            continue;
        error = exchange_transfers(message, first, transfer);
        if (error)
            break;
        first = NULL;
    }
    message->status = error;
    spi_finalize_current_message(controller);
    return 0;
}

/* GPIO ------------------------------------------------------------------------------------------------------------ */

static void set_reset(bool to)
{
    struct event event = {.kind = RESET_LEVEL, .value = to};

    mutex_lock(&lock);
    if (level[RESET] != to) {
        level[RESET] = to;
        event.at_ns = ktime_get_ns();
        kfifo_put(&resets, event);
    }
    mutex_unlock(&lock);
    wake_up_all(&changed);
}

static int line_direction(struct gpio_chip *chip, unsigned int line)
{
    return line == BUSY ? GPIO_LINE_DIRECTION_IN : GPIO_LINE_DIRECTION_OUT;
}

static int line_input(struct gpio_chip *chip, unsigned int line)
{
    return line == BUSY ? 0 : -EPERM;
}

static int line_output(struct gpio_chip *chip, unsigned int line, int to)
{
    if (line == BUSY)
        return -EPERM;
    set_reset(to);
    return 0;
}

static void line_set(struct gpio_chip *chip, unsigned int line, int to)
{
    if (line == RESET)
        set_reset(to);
}

static int line_get(struct gpio_chip *chip, unsigned int line)
{
    return READ_ONCE(level[line]);
}

static const char *const line_names[LINES] = {"BUSY", "RESET"};
static struct gpio_chip lines = {
    .label = "ecm-board",
    .owner = THIS_MODULE,
    .base = -1,
    .ngpio = LINES,
    .names = line_names,
    .can_sleep = true,
    .get_direction = line_direction,
    .direction_input = line_input,
    .direction_output = line_output,
    .get = line_get,
    .set = line_set,
};

static void edges_off(struct irq_data *data)
{
    WRITE_ONCE(masked, true);
    gpiochip_disable_irq(&lines, irqd_to_hwirq(data));
}

static void edges_on(struct irq_data *data)
{
    gpiochip_enable_irq(&lines, irqd_to_hwirq(data));
    WRITE_ONCE(masked, false);
}

static int edges_wanted(struct irq_data *data, unsigned int type)
{
    if (irqd_to_hwirq(data) != BUSY || (type & ~IRQ_TYPE_EDGE_BOTH))
        return -EINVAL;
    WRITE_ONCE(edges, type);
    return 0;
}

static const struct irq_chip line_edges = {
    .name = "ecm-board",
    .irq_mask = edges_off,
    .irq_unmask = edges_on,
    .irq_set_type = edges_wanted,
    .flags = IRQCHIP_IMMUTABLE,
    GPIOCHIP_IRQ_RESOURCE_HELPERS,
};

static void set_busy(bool to)
{
    bool edge;

    mutex_lock(&lock);
    edge = level[BUSY] != to;
    WRITE_ONCE(level[BUSY], to);
    mutex_unlock(&lock);
    if (edge && !READ_ONCE(masked) && (READ_ONCE(edges) & (to ? IRQ_TYPE_EDGE_RISING : IRQ_TYPE_EDGE_FALLING)))
        generic_handle_domain_irq_safe(lines.irq.domain, BUSY);
}

/* The board's side ------------------------------------------------------------------------------------------------ */

static int board_open(struct inode *inode, struct file *file)
{
    int error = 0;

    mutex_lock(&lock);
    if (played)
        error = -EBUSY;
    else {
        kfifo_reset(&resets);
        played = true;
    }
    mutex_unlock(&lock);
    return error;
}

static int board_release(struct inode *inode, struct file *file)
{
    mutex_lock(&lock);
    played = false;
    mutex_unlock(&lock);
    wake_up_all(&changed);
    set_busy(false);
    return 0;
}

static bool has_event(void)
{
    return !kfifo_is_empty(&resets) || READ_ONCE(exchange) == OFFERED;
}

static ssize_t board_read(struct file *file, char __user *to, size_t size, loff_t *at)
{
    struct event event;
    ssize_t length = -EAGAIN;

    while (length == -EAGAIN) {
        if (!(file->f_flags & O_NONBLOCK) && wait_event_interruptible(changed, has_event()))
            return -ERESTARTSYS;
        mutex_lock(&lock);
        if (kfifo_get(&resets, &event)) {
            length = sizeof(event);
        } else if (exchange == OFFERED) {
            event = exchanged;
            length = sizeof(event) + event.value;
        }
        if (length > 0 && size < length)
            length = -EMSGSIZE;
        else if (length > 0 && copy_to_user(to, &event, sizeof(event)))
            length = -EFAULT;
        else if (length > (ssize_t)sizeof(event) && copy_to_user(to + sizeof(event), from_host, event.value))
            length = -EFAULT;
        if (length > 0 && event.kind == EXCHANGE)
            exchange = TAKEN;
        mutex_unlock(&lock);
        if (file->f_flags & O_NONBLOCK)
            break;
    }
    return length;
}

static ssize_t board_write(struct file *file, const char __user *from, size_t size, loff_t *at)
{
    u8 kind, to;
    ssize_t done = size;

    if (size < 2 || get_user(kind, from) || get_user(to, from + 1))
        return -EINVAL;
    if (kind == BUSY_LEVEL) {
        set_busy(to);
        return size;
    }
    mutex_lock(&lock);
    if (kind != ANSWER || size - 1 != exchanged.value)
        done = -EINVAL;
    else if (exchange != TAKEN)
        done = -EPIPE; /* the host has given it up */
    else if (copy_from_user(to_host, from + 1, size - 1))
        done = -EFAULT;
    else
        exchange = ANSWERED;
    mutex_unlock(&lock);
    wake_up_all(&changed);
    return done;
}

static __poll_t board_poll(struct file *file, poll_table *table)
{
    poll_wait(file, &changed, table);
    return EPOLLOUT | (has_event() ? EPOLLIN : 0);
}

static const struct file_operations board_operations = {
    .owner = THIS_MODULE,
    .open = board_open,
    .release = board_release,
    .read = board_read,
    .write = board_write,
    .poll = board_poll,
};
static struct miscdevice board = {.minor = MISC_DYNAMIC_MINOR, .name = "ecm-board", .fops = &board_operations};

/* The module ------------------------------------------------------------------------------------------------------ */

static struct platform_device *place;
static struct spi_controller *controller;

static int register_controller(void)
{
    /* spidev accepts devices only by chip names; this is one of them. */
    struct spi_board_info chip = {.modalias = "dh2228fv", .max_speed_hz = MAX_HZ};
    int error;

    controller = spi_alloc_master(&place->dev, 0);
    if (!controller)
        return -ENOMEM;
    controller->bus_num = 0;
    controller->num_chipselect = 1;
    controller->mode_bits = SPI_CPOL | SPI_CPHA | SPI_LSB_FIRST | SPI_CS_HIGH;
    controller->bits_per_word_mask = SPI_BPW_MASK(8);
    controller->max_speed_hz = MAX_HZ;
    controller->transfer_one_message = transfer_message;
    error = spi_register_controller(controller);
    if (error) {
        spi_controller_put(controller);
        return error;
    }
    if (!spi_new_device(controller, &chip)) {
        spi_unregister_controller(controller);
        return -ENODEV;
    }
    return 0;
}

static int __init board_init(void)
{
    int error;

    place = platform_device_register_simple("ecm-board", PLATFORM_DEVID_NONE, NULL, 0);
    if (IS_ERR(place))
        return PTR_ERR(place);
    lines.parent = &place->dev;
    gpio_irq_chip_set_chip(&lines.irq, &line_edges);
    lines.irq.handler = handle_simple_irq;
    lines.irq.default_type = IRQ_TYPE_NONE;
    error = gpiochip_add_data(&lines, NULL);
    if (error)
        goto no_lines;
    error = register_controller();
    if (error)
        goto no_controller;
    error = misc_register(&board);
    if (!error)
        return 0;
    spi_unregister_controller(controller);
no_controller:
    gpiochip_remove(&lines);
no_lines:
    platform_device_unregister(place);
    return error;
}

static void __exit board_exit(void)
{
    misc_deregister(&board);
    spi_unregister_controller(controller);
    gpiochip_remove(&lines);
    platform_device_unregister(place);
}

module_init(board_init);
module_exit(board_exit);
MODULE_DESCRIPTION("A board on SPI for a machine that has none");
MODULE_LICENSE("Dual MIT/GPL");
