"""Files of the Hugging Face hub in its own cache; HF_HOME, HF_HUB_OFFLINE, HF_ENDPOINT hold."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from doorway3ds.errors import UserError

INSTALL = "pip install 'doorway3ds[hub]'"


@dataclass(frozen=True)
class HubFile:
    """One file of one commit of a repository."""

    repo: str
    file: str
    revision: str

    def __str__(self) -> str:
        return f"{self.repo}/{self.file}"


def cached(wanted: HubFile) -> Path | None:
    """Where the file lies in the cache, without any network; None if it does not."""
    try:
        from huggingface_hub import try_to_load_from_cache
    except ImportError:
        return None
    found = try_to_load_from_cache(wanted.repo, wanted.file, revision=wanted.revision)
    return Path(found) if isinstance(found, str) and Path(found).is_file() else None


def download(wanted: HubFile, *, again: bool = False) -> Path:
    """The file in the cache, fetched if it is not there, or in any case `again`.

    Raises UserError, one line, without the package, a network or such a file.
    """
    try:
        import huggingface_hub
        from huggingface_hub import constants, errors
        from huggingface_hub.utils import logging
    except ImportError as error:
        raise UserError(f"{wanted} is fetched with huggingface_hub: {INSTALL}") from error
    logging.set_verbosity_error()  # it warns of every retry; what matters arrives as an exception
    try:
        path = huggingface_hub.hf_hub_download(
            wanted.repo, wanted.file, revision=wanted.revision, force_download=again
        )
        return Path(path)
    except errors.LocalEntryNotFoundError as error:
        offline = "is not asked while HF_HUB_OFFLINE is set"
        raise UserError(
            f"{wanted} is not in the cache {constants.HF_HUB_CACHE}, and the hub "
            f"{constants.ENDPOINT} {offline if constants.HF_HUB_OFFLINE else 'cannot be reached'}; "
            f"fetch it with a network, or copy the cache of a machine that has it"
        ) from error
    except errors.HfHubHTTPError as error:
        status = error.response.status_code if error.response is not None else "no answer"
        raise UserError(
            f"the hub {constants.ENDPOINT} does not return {wanted}: status {status}"
        ) from error
    except (OSError, ValueError) as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise UserError(f"{wanted} cannot be fetched: {reason}") from error
