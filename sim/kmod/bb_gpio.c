// SPDX-License-Identifier: MIT OR GPL-2.0-only
/*
 * sim/kmod/bb_gpio.c: a GPIO chip of 8 lines whose far end is a text file, for kernels without gpio-sim. Programs see an
 * ordinary /dev/gpiochipN (label "bb-gpio"); tests write to /dev/bb-gpio, one command a write:
 *
 *   set L V      the world puts line L to V (0 or 1)
 *   wave L NS    line L changes its level every NS ns (100 us .. 10 s), on an absolute grid: a late tick does not move
 *                the next ones, and ticks that were slept through are skipped in pairs so that the parity holds
 *   miss L N     the next N changes of line L reach no program: the interrupt is lost, the level is not
 *   stop         the wave ends; the level stays
 *
 * Reading gives the levels of all lines, line 0 first, as "01000000\n": outputs as driven, inputs as the world has them.
 * Edges are delivered from a hard irq_work, the context of an interrupt. Lines are either inputs of the world's or
 * outputs of a program's; a wave on an output line is refused.
 */
#include <linux/bitmap.h>
#include <linux/fs.h>
#include <linux/gpio/driver.h>
#include <linux/hrtimer.h>
#include <linux/irq.h>
#include <linux/irq_work.h>
#include <linux/irqdomain.h>
#include <linux/miscdevice.h>
#include <linux/module.h>
#include <linux/platform_device.h>
#include <linux/slab.h>
#include <linux/spinlock.h>
#include <linux/uaccess.h>

#define LINES 8
#define LEAST_NS 100000ULL
#define MOST_NS 10000000000ULL

struct bb_chip {
	struct gpio_chip gc;
	struct miscdevice misc;
	struct irq_work work;
	struct hrtimer timer;
	raw_spinlock_t lock; /* everything below */
	unsigned long levels, inputs, rising, falling, enabled, pending;
	unsigned int wave_line, missed[LINES];
	u64 wave_ns;
};

/* ---- edges ---- */

/* With the lock held. True: somebody waits for that edge. */
static bool put_level(struct bb_chip *c, unsigned int line, bool level)
{
	if (level == test_bit(line, &c->levels))
		return false;
	__assign_bit(line, &c->levels, level);
	if (c->missed[line]) {
		c->missed[line]--;
		return false;
	}
	if (!test_bit(line, &c->enabled) || !test_bit(line, level ? &c->rising : &c->falling))
		return false;
	__set_bit(line, &c->pending);
	return true;
}

static void deliver(struct irq_work *work)
{
	struct bb_chip *c = container_of(work, struct bb_chip, work);
	unsigned long flags, pending;
	unsigned int line;

	raw_spin_lock_irqsave(&c->lock, flags);
	pending = c->pending;
	c->pending = 0;
	raw_spin_unlock_irqrestore(&c->lock, flags);
	for_each_set_bit(line, &pending, LINES)
		generic_handle_domain_irq(c->gc.irq.domain, line);
}

static enum hrtimer_restart tick(struct hrtimer *timer)
{
	struct bb_chip *c = container_of(timer, struct bb_chip, timer);
	bool wanted = false, more;
	unsigned long flags;
	u64 passed;

	raw_spin_lock_irqsave(&c->lock, flags);
	more = c->wave_ns != 0;
	if (more) {
		passed = hrtimer_forward_now(timer, ns_to_ktime(c->wave_ns));
		if (passed & 1)
			wanted = put_level(c, c->wave_line, !test_bit(c->wave_line, &c->levels));
	}
	raw_spin_unlock_irqrestore(&c->lock, flags);
	if (wanted)
		irq_work_queue(&c->work);
	return more ? HRTIMER_RESTART : HRTIMER_NORESTART;
}

/* ---- the chip as the kernel sees it ---- */

static int bb_get(struct gpio_chip *gc, unsigned int line)
{
	struct bb_chip *c = gpiochip_get_data(gc);

	return test_bit(line, &c->levels);
}

static void bb_set(struct gpio_chip *gc, unsigned int line, int value)
{
	struct bb_chip *c = gpiochip_get_data(gc);
	unsigned long flags;

	raw_spin_lock_irqsave(&c->lock, flags);
	__assign_bit(line, &c->levels, value);
	raw_spin_unlock_irqrestore(&c->lock, flags);
}

static int bb_direction(struct bb_chip *c, unsigned int line, bool input, int value)
{
	unsigned long flags;
	int ret = 0;

	raw_spin_lock_irqsave(&c->lock, flags);
	if (!input && c->wave_ns && line == c->wave_line)
		ret = -EBUSY; /* two drivers on one wire */
	if (!ret) {
		__assign_bit(line, &c->inputs, input);
		if (!input)
			__assign_bit(line, &c->levels, value);
	}
	raw_spin_unlock_irqrestore(&c->lock, flags);
	return ret;
}

static int bb_direction_input(struct gpio_chip *gc, unsigned int line)
{
	return bb_direction(gpiochip_get_data(gc), line, true, 0);
}

static int bb_direction_output(struct gpio_chip *gc, unsigned int line, int value)
{
	return bb_direction(gpiochip_get_data(gc), line, false, value);
}

static int bb_get_direction(struct gpio_chip *gc, unsigned int line)
{
	struct bb_chip *c = gpiochip_get_data(gc);

	return test_bit(line, &c->inputs) ? GPIO_LINE_DIRECTION_IN : GPIO_LINE_DIRECTION_OUT;
}

static void bb_enable(struct irq_data *d, bool on)
{
	struct gpio_chip *gc = irq_data_get_irq_chip_data(d);
	struct bb_chip *c = gpiochip_get_data(gc);
	unsigned long flags;

	raw_spin_lock_irqsave(&c->lock, flags);
	__assign_bit(irqd_to_hwirq(d), &c->enabled, on);
	raw_spin_unlock_irqrestore(&c->lock, flags);
}

static void bb_irq_mask(struct irq_data *d)
{
	bb_enable(d, false);
	gpiochip_disable_irq(irq_data_get_irq_chip_data(d), irqd_to_hwirq(d));
}

static void bb_irq_unmask(struct irq_data *d)
{
	gpiochip_enable_irq(irq_data_get_irq_chip_data(d), irqd_to_hwirq(d));
	bb_enable(d, true);
}

static int bb_irq_set_type(struct irq_data *d, unsigned int type)
{
	struct bb_chip *c = gpiochip_get_data(irq_data_get_irq_chip_data(d));
	unsigned long flags;

	if (type & ~IRQ_TYPE_EDGE_BOTH)
		return -EINVAL;
	raw_spin_lock_irqsave(&c->lock, flags);
	__assign_bit(irqd_to_hwirq(d), &c->rising, type & IRQ_TYPE_EDGE_RISING);
	__assign_bit(irqd_to_hwirq(d), &c->falling, type & IRQ_TYPE_EDGE_FALLING);
	raw_spin_unlock_irqrestore(&c->lock, flags);
	return 0;
}

static const struct irq_chip bb_irq_chip = {
	.name = "bb-gpio",
	.irq_mask = bb_irq_mask,
	.irq_unmask = bb_irq_unmask,
	.irq_set_type = bb_irq_set_type,
	.flags = IRQCHIP_IMMUTABLE,
	GPIOCHIP_IRQ_RESOURCE_HELPERS,
};

/* ---- the world's side ---- */

static int command_set(struct bb_chip *c, unsigned int line, unsigned int level)
{
	unsigned long flags;
	bool wanted = false;
	int ret = 0;

	if (line >= LINES || level > 1)
		return -EINVAL;
	raw_spin_lock_irqsave(&c->lock, flags);
	if (!test_bit(line, &c->inputs) || (c->wave_ns && line == c->wave_line))
		ret = -EBUSY;
	else
		wanted = put_level(c, line, level);
	raw_spin_unlock_irqrestore(&c->lock, flags);
	if (wanted)
		irq_work_queue(&c->work);
	return ret;
}

static int command_miss(struct bb_chip *c, unsigned int line, unsigned int n)
{
	unsigned long flags;

	if (line >= LINES)
		return -EINVAL;
	raw_spin_lock_irqsave(&c->lock, flags);
	c->missed[line] = n;
	raw_spin_unlock_irqrestore(&c->lock, flags);
	return 0;
}

static void command_stop(struct bb_chip *c)
{
	unsigned long flags;

	raw_spin_lock_irqsave(&c->lock, flags);
	c->wave_ns = 0;
	raw_spin_unlock_irqrestore(&c->lock, flags);
	hrtimer_cancel(&c->timer);
}

static int command_wave(struct bb_chip *c, unsigned int line, u64 ns)
{
	unsigned long flags;
	int ret = 0;

	if (line >= LINES || ns < LEAST_NS || ns > MOST_NS)
		return -EINVAL;
	command_stop(c);
	raw_spin_lock_irqsave(&c->lock, flags);
	if (!test_bit(line, &c->inputs)) {
		ret = -EBUSY;
	} else {
		c->wave_line = line;
		c->wave_ns = ns;
	}
	raw_spin_unlock_irqrestore(&c->lock, flags);
	if (!ret)
		hrtimer_start(&c->timer, ns_to_ktime(ns), HRTIMER_MODE_REL_HARD);
	return ret;
}

static ssize_t world_write(struct file *file, const char __user *from, size_t n, loff_t *pos)
{
	struct bb_chip *c = container_of(file->private_data, struct bb_chip, misc);
	unsigned int line, level; /* or a count */
	char text[48], end;
	int ret = -EINVAL;
	u64 ns;

	if (n >= sizeof(text))
		return -EINVAL;
	if (copy_from_user(text, from, n))
		return -EFAULT;
	text[n] = '\0';
	if (sscanf(text, "set %u %u %c", &line, &level, &end) == 2)
		ret = command_set(c, line, level);
	else if (sscanf(text, "miss %u %u %c", &line, &level, &end) == 2)
		ret = command_miss(c, line, level);
	else if (sscanf(text, "wave %u %llu %c", &line, &ns, &end) == 2)
		ret = command_wave(c, line, ns);
	else if (sysfs_streq(text, "stop")) {
		command_stop(c);
		ret = 0;
	}
	return ret ? ret : n;
}

static ssize_t world_read(struct file *file, char __user *to, size_t n, loff_t *pos)
{
	struct bb_chip *c = container_of(file->private_data, struct bb_chip, misc);
	const unsigned long levels = READ_ONCE(c->levels);
	char text[LINES + 1];
	unsigned int i;

	for (i = 0; i < LINES; i++)
		text[i] = test_bit(i, &levels) ? '1' : '0';
	text[LINES] = '\n';
	return simple_read_from_buffer(to, n, pos, text, sizeof(text));
}

static const struct file_operations world_ops = {
	.owner = THIS_MODULE,
	.read = world_read,
	.write = world_write,
	.llseek = default_llseek,
};

/* ---- coming and going ---- */

static void fill_chip(struct bb_chip *c, struct device *dev)
{
	struct gpio_irq_chip *girq = &c->gc.irq;

	raw_spin_lock_init(&c->lock);
	c->work = IRQ_WORK_INIT_HARD(deliver);
	hrtimer_init(&c->timer, CLOCK_MONOTONIC, HRTIMER_MODE_REL_HARD);
	c->timer.function = tick;
	c->inputs = GENMASK(LINES - 1, 0);
	c->gc.label = "bb-gpio";
	c->gc.parent = dev;
	c->gc.owner = THIS_MODULE;
	c->gc.base = -1;
	c->gc.ngpio = LINES;
	c->gc.get = bb_get;
	c->gc.set = bb_set;
	c->gc.direction_input = bb_direction_input;
	c->gc.direction_output = bb_direction_output;
	c->gc.get_direction = bb_get_direction;
	gpio_irq_chip_set_chip(girq, &bb_irq_chip);
	girq->default_type = IRQ_TYPE_NONE;
	girq->handler = handle_simple_irq;
	c->misc.minor = MISC_DYNAMIC_MINOR;
	c->misc.name = "bb-gpio";
	c->misc.fops = &world_ops;
	c->misc.mode = 0600;
}

static int bb_probe(struct platform_device *pdev)
{
	struct bb_chip *c = devm_kzalloc(&pdev->dev, sizeof(*c), GFP_KERNEL);
	int ret;

	if (!c)
		return -ENOMEM;
	fill_chip(c, &pdev->dev);
	platform_set_drvdata(pdev, c);
	ret = devm_gpiochip_add_data(&pdev->dev, &c->gc, c);
	return ret ? ret : misc_register(&c->misc);
}

static int bb_remove(struct platform_device *pdev)
{
	struct bb_chip *c = platform_get_drvdata(pdev);

	misc_deregister(&c->misc);
	command_stop(c);
	irq_work_sync(&c->work);
	return 0;
}

static struct platform_driver bb_driver = {
	.probe = bb_probe,
	.remove = bb_remove,
	.driver = { .name = "bb-gpio", .suppress_bind_attrs = true },
};
static struct platform_device *bb_device;

static int __init bb_init(void)
{
	int ret = platform_driver_register(&bb_driver);

	if (ret)
		return ret;
	bb_device = platform_device_register_simple("bb-gpio", PLATFORM_DEVID_NONE, NULL, 0);
	if (IS_ERR(bb_device)) {
		platform_driver_unregister(&bb_driver);
		return PTR_ERR(bb_device);
	}
	return 0;
}

static void __exit bb_exit(void)
{
	platform_device_unregister(bb_device);
	platform_driver_unregister(&bb_driver);
}

module_init(bb_init);
module_exit(bb_exit);
MODULE_DESCRIPTION("GPIO lines driven by a test, with a stereo sync generator");
MODULE_LICENSE("Dual MIT/GPL");
