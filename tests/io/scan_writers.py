"""Scan files of every format, as their own software writes them."""

import h5py
import numpy as np
import scipy.io

from jaxtat.io import Scan, save_ipasc


def write_named(path, **arrays):
    """Arrays by name in .npz, .h5 or .hdf5, or .mat (version 5, compressed)."""
    if path.suffix == ".npz":
        np.savez_compressed(path, **arrays)
    elif path.suffix == ".mat":
        scipy.io.savemat(path, arrays, do_compression=True)
    else:
        with h5py.File(path, "w") as file:
            for name, array in arrays.items():
                file[name] = array
    return path


def write_matlab73(path, **arrays):
    """What MATLAB's save -v7.3 writes: HDF5 behind a header of 512 bytes, axes reversed, packed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in arrays.items():
            array = np.atleast_2d(array)
            what = {"f": "double", "u": "uint16"}.get(array.dtype.kind, "int32")
            file.create_dataset(name, data=array.T, compression="gzip", chunks=array.T.shape)
            file[name].attrs["MATLAB_class"] = np.bytes_(what)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")
    return path


def write_msot(path, data, positions, megahertz=40.0, wavelengths=(), places=None, response=None):
    """NAME.msot with what a reader needs of it, NAME.bin, and NAME.irf if there is a response."""
    detectors = "".join(
        f'<PROJECTION wavelength-ref="all" number="{number}">'
        + "".join(f'<VALUE axis-ref="{axis}">{x!r}</VALUE>' for axis, x in enumerate(place, 1))
        + "</PROJECTION>"
        for number, place in enumerate(np.asarray(positions).tolist(), 1)
    )
    frames = "".join(
        f'<DataModelScanFrame><Frame timestamp="6373"><WAVELENGTH unit="m" unit-modifier="n">'
        f"{wavelength!r}</WAVELENGTH><TEMPERATURE>33.5</TEMPERATURE></Frame>"
        f"<IDOffset>{place}</IDOffset></DataModelScanFrame>"
        for wavelength, place in zip(
            wavelengths, range(len(data)) if places is None else places, strict=True
        )
    )
    path.write_text(
        '<?xml version="1.0" encoding="utf-8"?><DataModelMsotProject>'
        '<HARDWARE-DESC xmlns="Header_Schema"><SAMPLING-FREQUENCY unit="Hz" unit-modifier="M">'
        f"{megahertz!r}</SAMPLING-FREQUENCY><FRAME-DESC>{detectors}</FRAME-DESC></HARDWARE-DESC>"
        f'<MEASUREMENT-DESC xmlns="Header_Schema"><RECORDED-LENGTH>{data.shape[-1]}'
        "</RECORDED-LENGTH></MEASUREMENT-DESC><ScanNode><Name>a scan</Name><DeviceSN>7</DeviceSN>"
        f"<ScanFrames>{frames}</ScanFrames></ScanNode></DataModelMsotProject>"
    )
    path.with_suffix(".bin").write_bytes(data.astype("<u2").tobytes())
    if response is not None:
        path.with_suffix(".irf").write_bytes(np.asarray(response, "<f8").tobytes())
    return path


def write_patato(path, data, positions, rate):
    """What PATATO's importer writes that a reader needs, as frames of one wavelength."""
    with h5py.File(path, "w") as file:
        file["raw_data"] = data[:, None]
        file["raw_data"].attrs.update({"fs": rate, "name": "a scan", "speedofsound": 1500.0})
        file["wavelengths"] = np.array([700.0])
        for name, array in {
            "GEOMETRY": positions,
            "OverallCorrectionFactor": np.full((len(data), 1), 60.0),
            "irf": np.eye(1, data.shape[-1])[0],
        }.items():
            file.create_dataset(name, data=array, compression="gzip")
    return path


def write_everything(folder, data, positions, rate):
    """One scan in every format: data (frames, detectors, samples) of type uint16, paths by name."""
    known = {"detectors": positions, "sampling_rate": rate}
    matlab = {"raw": np.moveaxis(data, 0, -1), "positions": positions, "fs": rate}
    paths = {
        "npz": write_named(folder / "a.npz", raw=data, positions=positions, fs=rate),
        "npy": folder / "a.npy",
        "hdf5": write_named(folder / "a.h5", raw=data, positions=positions, fs=rate),
        "ipasc": folder / "a.hdf5",
        "patato": write_patato(folder / "b.hdf5", data, positions, rate),
        "matlab 5": write_named(folder / "a.mat", **matlab),
        "matlab 7.3": write_matlab73(folder / "b.mat", **matlab),
        "msot": write_msot(
            folder / "a.msot", data, positions, rate / 1e6, wavelengths=[700.0] * len(data)
        ),
    }
    np.save(paths["npy"], data)
    save_ipasc(paths["ipasc"], Scan("pressure", data, known, {"device": "of a test"}))
    return paths
