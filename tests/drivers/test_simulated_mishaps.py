"""What befalls the simulated machine's frames on their way."""

import asyncio
import itertools

from drivers.simulated.faults import Faults, Mishaps

PERIOD_S = 0.02
LINES = [b"%d," % number for number in range(1000)]


def passed(**faults):
    """The numbers of the lines that came, in their order."""
    written = []
    mishaps = Mishaps(written.append, seed=3)
    mishaps.set(Faults(**faults))
    for line in LINES:
        mishaps.send(line, PERIOD_S)
    return [int(number) for number in b"".join(written).split(b",")[:-1]]


def test_without_a_fault_every_line_passes_as_it_is():
    assert passed() == list(range(1000))


def test_a_share_of_the_lines_is_dropped_doubled_or_overtaken():
    dropped = passed(drop_can=0.1)
    assert 850 < len(dropped) < 950
    assert dropped == sorted(dropped)
    doubled = passed(double_can=0.1)
    assert sorted(set(doubled)) == list(range(1000))
    assert 1050 < len(doubled) < 1150
    swapped = passed(swap_can=0.1)
    backwards = sum(b < a for a, b in itertools.pairwise(swapped))
    assert 50 < backwards < 150
    assert len(swapped) >= 999  # the last may wait for one to overtake it


async def test_a_hold_up_keeps_lines_and_then_delivers_them_at_once():
    written: asyncio.Queue[bytes] = asyncio.Queue()
    mishaps = Mishaps(written.put_nowait, seed=3)
    mishaps.send(b"before,", PERIOD_S)
    mishaps.set(Faults(hold_can_s=0.01))
    mishaps.send(b"1,", PERIOD_S)
    mishaps.send(b"2,", PERIOD_S)
    assert written.get_nowait() == b"before,"
    assert written.empty()
    async with asyncio.timeout(10.0):
        assert await written.get() == b"1,2,"
    mishaps.send(b"after,", PERIOD_S)
    assert written.get_nowait() == b"after,"


async def test_hold_ups_come_again_and_again():
    written = []
    mishaps = Mishaps(written.append, seed=3)
    mishaps.set(Faults(hold_can_s=0.001, hold_can_every_s=0.1))
    async with asyncio.timeout(20.0):
        while sum(lines.count(b",") > 1 for lines in written) < 3:
            for line in LINES[:5]:
                mishaps.send(line, PERIOD_S)
            await asyncio.sleep(0.0005)
