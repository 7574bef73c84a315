"""The files of a record of Zenodo, checked by the checksums that Zenodo itself gives for them."""

from pathlib import Path
from typing import Any

from ..base.optional_packages import optional

SITE = "https://zenodo.org"


def download_record(number: int, folder: Path, *, site: str = SITE) -> list[Path]:
    """Downloads what is not in the folder yet; its files, in Zenodo's order.

    Args:
        number: of the record, as at the end of its address.
        folder: for the files; archives are left as they are.

    Raises:
        ConnectionError: without an answer, or with one that is no record.
        ValueError: for a file that is not the one Zenodo has, or without pooch.
    """
    pooch = optional("pooch", "downloading data")
    listing = f"{site}/api/records/{number}"
    try:
        requests: Any = optional("requests", "downloading data")
        answer = requests.get(listing, timeout=60)
        answer.raise_for_status()
        files = [(f["key"], f["checksum"], f["links"]["self"]) for f in answer.json()["files"]]
        return [
            Path(pooch.retrieve(address, known, Path(name).name, folder))
            for name, known, address in files
        ]
    except (OSError, KeyError, TypeError) as error:  # what requests raises is an OSError
        raise ConnectionError(
            f"cannot download record {number} of {site} ({type(error).__name__}: {error}). Without "
            f"a network: get its files from {site}/records/{number}."
        ) from error
