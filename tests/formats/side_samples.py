"""Side files as the recorders' makers lay them out, written by the tests."""

from collections.abc import Sequence


def sentence(body: str) -> str:
    """A NMEA sentence with its checksum."""
    checksum = 0
    for byte in body.encode():
        checksum ^= byte
    return f"${body}*{checksum:02X}"


def gga(n: int, *, quality: int = 1, separation: str = "46.25,M") -> str:
    """Fix number n: 46.2 N, 12.97 E and n ten-thousandths of a minute further, at 130 m and n cm."""
    place = f"4612.{n:06d},N,01258.{n:06d},E" if quality else ",,,"
    return sentence(
        f"GPGGA,10{n // 60 % 60:02d}{n % 60:02d}.00,{place},{quality},07,1.5,{130 + n / 100:.2f},M,{separation},,"
    )


def gga_at(second: int, latitude_deg: float, longitude_deg: float) -> str:
    """A fix of a northern place, to a millionth of a minute, so many seconds after ten."""

    def minutes(degrees: float, width: int) -> str:
        whole, part = divmod(round(abs(degrees) * 60e6), 60_000_000)
        return f"{whole:0{width}d}{part / 1e6:09.6f}"

    clock = f"10{second // 60 % 60:02d}{second % 60:02d}.00"
    place = f"{minutes(latitude_deg, 2)},N,{minutes(longitude_deg, 3)},{'W' if longitude_deg < 0.0 else 'E'}"
    return sentence(f"GPGGA,{clock},{place},4,09,0.9,500.00,M,46.00,M,,")


def rmc(n: int, *, status: str = "A") -> str:
    """The same place by RMC."""
    clock = f"10{n // 60 % 60:02d}{n % 60:02d}.00"
    return sentence(f"GPRMC,{clock},{status},4612.{n:06d},N,01258.{n:06d},E,000.4,323.4,081011,0.2,E,A")


def gps_text(traces: Sequence[Sequence[str]], *, first: int = 1, end: str = "\r\r\n") -> str:
    """A ``.GPS`` file of the sentences of each trace."""
    lines = (
        f"Trace #{first + n} at position {0.25 * n:.6f}\r\n" + "".join(line + end for line in each)
        for n, each in enumerate(traces)
    )
    return "".join(lines)


def dzg_text(scans: dict[int, Sequence[str]]) -> str:
    """A ``.DZG`` file of the sentences of scans."""
    return "".join(f"$GSSIS,{n},-1\r\n" + "".join(line + "\r\n" for line in each) + "\r\n" for n, each in scans.items())


def cor_row(trace: int, *, latitude: str = "46.2\tN", longitude: str = "12.97\tE", extra: str = "\t1.2") -> str:
    """A row of a ``.cor`` file."""
    return (
        f"{trace}\t2011-10-08\t10:00:{trace % 60:02d}\t{latitude}\t{longitude}\t{130 + trace / 100:.2f}\tM{extra}\r\n"
    )
