"""What the ranks of a plan take, by a discrete-event simulation of their messages.

A rank takes steps of its batches: it packs its edge cells and sends them to the blocks next to its
own, computes the rows that need no ghosts, waits for the messages, unpacks them, and computes the
rest. Where steps are blocked (src/matrix/blocking.rs), only the first exchange of a trip through
memory has rows to compute beside it. A batch ends with the norms of its modes, two reductions over
the blocks. A run ends with the recovered fields: sums over the mode groups, each to the rank that
keeps its share of the block.

Messages from a node to others queue for its one link. A message within a node needs no link; its
receiver copies it once more.

Batches, blocks and modes are those of `phasewarp plan --json`. All ranks take a window of steps at
once; the steps of a group that are left take as long as those of the second half of the window.
Not simulated: auxiliary unknowns of the inflow, caches, and the memory that ranks of a node share.
A row takes as long on each rank.
"""

import heapq
import math

# Modes of a batch, and bytes of a row of their vectors.
LANES, BYTES_A_ROW = 8, 128
# A block with more rows than this is out of the cache of a core (1 MiB), and its steps are blocked.
ROWS_IN_CACHE = 2000
# Steps of the window.
WINDOW = 12


class Network:
    """Times in seconds, rates in bytes a second; `ideal` costs nothing."""
    def __init__(self, latency, bandwidth, ranks_per_node, near_latency, overhead, copy):
        self.latency, self.bandwidth, self.ranks_per_node = latency, bandwidth, ranks_per_node
        self.near_latency, self.overhead, self.copy = near_latency, overhead, copy

    @classmethod
    def ideal(cls):
        return cls(0.0, math.inf, 1, 0.0, 0.0, math.inf)

    def near(self, a, b):
        return a // self.ranks_per_node == b // self.ranks_per_node

    def sending(self, size):
        """Seconds of the sender's processor for a message."""
        return self.overhead + size / self.copy

    def receiving(self, a, b, size):
        """Seconds of the processor of `b` for a message from `a`."""
        return self.overhead + (2 if self.near(a, b) else 1) * size / self.copy


class Events:
    """Ranks as generators: each yields (seconds that it is busy, tag and number of messages that it
    then waits for), and is resumed with the time at which it goes on."""
    def __init__(self, network):
        self.network, self.queue = network, []
        self.out, self.into = {}, {}  # when the links of a node are free
        self.mail = {}  # (rank, tag): messages sent so far, arrival of the last
        self.waiting = {}  # (rank, tag): number, earliest time to go on

    def send(self, now, source, target, size, tag):
        network = self.network
        if network.near(source, target):
            arrival = now + network.near_latency
        else:
            a, b = source // network.ranks_per_node, target // network.ranks_per_node
            duration = size / network.bandwidth
            self.out[a] = max(now, self.out.get(a, 0.0)) + duration
            arrival = max(self.out[a] + network.latency, self.into.get(b, 0.0) + duration)
            self.into[b] = arrival
        count, last = self.mail.get((target, tag), (0, 0.0))
        self.mail[target, tag] = count + 1, max(last, arrival)
        self.resume(target, tag)

    def resume(self, rank, tag):
        """Lets the rank go on if all that it waits for is sent."""
        wanted, earliest = self.waiting.get((rank, tag), (math.inf, 0.0))
        count, last = self.mail.get((rank, tag), (0, 0.0))
        if count >= wanted:
            del self.waiting[rank, tag]
            self.mail.pop((rank, tag), None)
            heapq.heappush(self.queue, (max(earliest, last), rank))

    def run(self, programs):
        self.queue = [(0.0, rank) for rank in range(len(programs))]
        for program in programs:
            next(program)
        left = len(programs)
        while self.queue:
            now, rank = heapq.heappop(self.queue)
            try:
                seconds, tag, count = programs[rank].send(now)
            except StopIteration:
                left -= 1
                continue
            self.waiting[rank, tag] = count, now + seconds
            self.resume(rank, tag)
        assert left == 0, "ranks wait for messages that no rank sends"


class Block:
    """A space block: rows, neighbours, and rows that are close to them."""
    def __init__(self, plan, position):
        mesh, axes = plan["layout"]["mesh"]["space"], len(plan["layout"]["mesh"]["space"])
        part = lambda n, parts, k: n * (k + 1) // parts - n * k // parts
        nodes = [s // e for s, e in zip(plan["shape"][:axes], plan["elements"])]
        self.sizes = [c * part(e, p, k)
                      for c, e, p, k in zip(nodes, plan["elements"], mesh, position)]
        self.velocities = math.prod(plan["shape"][axes:])
        self.rows = math.prod(self.sizes) * self.velocities
        strides = [math.prod(mesh[a + 1:]) for a in range(axes)]
        own = sum(k * stride for k, stride in zip(position, strides))
        self.neighbours, self.sides = [], [0] * axes  # (block, bytes of a message)
        for a, (k, stride) in enumerate(zip(position, strides)):
            for other in (k - 1, k + 1):
                if 0 <= other < mesh[a]:
                    layer = self.rows // self.sizes[a]
                    self.neighbours.append((own + (other - k) * stride, BYTES_A_ROW * layer))
                    self.sides[a] += 1

    def margin(self, layers):
        """Rows in so many layers of cells towards ghosts."""
        inner = (max(0, n - layers * s) for n, s in zip(self.sizes, self.sides))
        return self.rows - math.prod(inner) * self.velocities


class Run:
    """What the ranks of a plan do."""
    def __init__(self, plan, network, row_seconds, depth=1, window=WINDOW):
        mesh = plan["layout"]["mesh"]
        self.plan, self.network, self.window = plan, network, window
        self.blocks = [Block(plan, position) for position in positions(mesh["space"])]
        self.space, self.groups = len(self.blocks), mesh["groups"]
        # Of a step, for all modes of a batch.
        self.row_seconds = LANES * row_seconds
        self.most_rows = max(block.rows for block in self.blocks)
        shortest = min(block.sizes[0] for block in self.blocks)
        self.depth = min(depth, shortest) if self.most_rows > ROWS_IN_CACHE else 1
        fields = plan["fields"]
        # By group, of all fields.
        self.steps = [fields * sum(batch["cost"] for batch in group) // LANES
                      for group in plan["layout"]["groups"]]
        self.batches = [fields * len(group) for group in plan["layout"]["groups"]]
        warp = plan["warp"]
        self.sums = fields * len(warp["readings"]) + len(warp["plateau"])

    def balance(self):
        """Seconds of the rank with most rows of the group with most steps, without messages."""
        return max(self.steps) * self.most_rows * self.row_seconds

    def trip(self, events, rank, start):
        """The steps of a trip through memory, by a rank; `start` numbers them."""
        block, base = self.blocks[rank % self.space], rank - rank % self.space
        network = self.network
        pack = sum(network.sending(size) for _, size in block.neighbours)
        unpack = sum(network.receiving(base + n, rank, size) for n, size in block.neighbours)
        waiting = sum(block.margin(k) for k in range(1, self.depth + 1))
        for level in range(self.depth):
            now = yield pack, None, 0
            for neighbour, size in block.neighbours:
                events.send(now, rank, base + neighbour, size, start + level)
            first = (self.depth * block.rows - waiting) if level == 0 else 0
            yield first * self.row_seconds, start + level, len(block.neighbours)
            now = yield unpack + block.margin(self.depth - level) * self.row_seconds, None, 0
        return now

    def norms(self, events, rank, now):
        """Two reductions over the blocks of a group, to all of them."""
        own, base = rank % self.space, rank - rank % self.space
        for number in range(2):
            for k in range((self.space - 1).bit_length()):
                tag = "norms", number, k
                now = yield self.network.overhead, None, 0
                events.send(now, rank, base + (own + 2**k) % self.space, 16 * LANES, tag)
                yield 0.0, tag, 1
                now = yield self.network.overhead, None, 0
        return now

    def recovery(self, events, rank):
        """One sum of a field: for each group, its share of the block, over all groups to it."""
        block, own, group = self.blocks[rank % self.space], rank % self.space, rank // self.space
        layer = 16 * block.rows // block.sizes[0]
        for root in range(self.groups):
            n, groups = block.sizes[0], self.groups
            size = layer * (n * (root + 1) // groups - n * root // groups)
            place, bit = (group - root) % groups, 1
            while size and bit < groups and not place & bit:
                if place + bit < groups:
                    other = (place + bit + root) % groups * self.space + own
                    yield 0.0, (root, bit), 1
                    # Received, and added.
                    adding = self.network.receiving(other, rank, size) + size / self.network.copy
                    yield adding, None, 0
                bit *= 2
            if size and place:
                now = yield self.network.sending(size), None, 0
                target = (place - bit + root) % groups * self.space + own
                events.send(now, rank, target, size, (root, bit))

    def seconds(self):
        """Simulated seconds by part: rows, ghosts, norms, recovery."""
        ranks = self.space * self.groups
        trips = max(1, math.ceil(self.window / 2 / self.depth))
        half = trips * self.depth
        marks = [[0.0] * ranks for _ in range(3)]

        def steps(rank):
            now = yield
            if not self.batches[rank // self.space]:
                return
            for part in range(2):
                for trip in range(trips):
                    number = (part * trips + trip) * self.depth
                    now = yield from self.trip(events, rank, number)
                marks[part][rank] = now
            marks[2][rank] = yield from self.norms(events, rank, now)

        def recovery(rank):
            yield
            yield from self.recovery(events, rank)
            ends.append((yield 0.0, None, 0))

        events = Events(self.network)
        events.run([steps(rank) for rank in range(ranks)])
        slowest, norms = 0.0, 0.0
        for group, (count, batches) in enumerate(zip(self.steps, self.batches)):
            own = slice(group * self.space, (group + 1) * self.space)
            first, second, third = (max(mark[own]) for mark in marks)
            step = (second - first) / half
            # Of each batch: the window's beginning, its other steps, its norms.
            begun = max(0.0, first - half * step) * batches
            taken = begun + count * step + (third - second) * batches
            if taken > slowest:
                slowest, norms = taken, (third - second) * batches
        events, ends = Events(self.network), []
        events.run([recovery(rank) for rank in range(ranks)])
        rows = self.balance()
        return {"rows": rows, "ghosts": slowest - norms - rows, "norms": norms,
                "recovery": self.sums * max(ends)}


def positions(mesh):
    """Of the blocks in their mesh, in the order of their numbers."""
    found = [[]]
    for parts in mesh:
        found = [position + [k] for position in found for k in range(parts)]
    return found
