"""Convert rail-surface samples from and to `sensor_msgs/PointCloud2`.

x is the chainage, z the height, both in m, z up (REP-103).
"""

import sys

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from weld_force_ros.errors import MessageError
from weld_force_ros.messages import MAX_SAMPLES
from weld_force_ros.physics.arrays import FloatArray

TOPIC = "rail_surface_points"

_FORMATS = {PointField.FLOAT32: "f4", PointField.FLOAT64: "f8"}
_OWN_POINT = np.dtype([("x", "f8"), ("y", "f4"), ("z", "f4")])
_REMEDY = "publish fields x (chainage, m) and z (height, m, up) as float64, with sizes that fit the data"


def samples_of(cloud: PointCloud2) -> tuple[FloatArray, FloatArray]:
    """Return chainages and heights of a cloud in the order of its points, each (n,) in m; other fields are left out.

    Raises:
        MessageError: no such fields, more than `MAX_SAMPLES` points, or sizes that do not fit each other.
    """
    count = cloud.width * cloud.height
    if count > MAX_SAMPLES:
        raise MessageError(f"{TOPIC}: {count} points", f"send at most {MAX_SAMPLES} in one message")
    if count == 0:
        return np.empty(0), np.empty(0)
    needed_bytes = (cloud.height - 1) * cloud.row_step + cloud.width * cloud.point_step
    if len(cloud.data) < needed_bytes or (cloud.height > 1 and cloud.row_step < cloud.width * cloud.point_step):
        raise MessageError(
            f"{TOPIC}: {len(cloud.data)} bytes for {cloud.height} rows of {cloud.row_step} bytes with {cloud.width} "
            f"points of {cloud.point_step} bytes",
            _REMEDY,
        )
    order = ">" if cloud.is_bigendian else "<"
    columns = [_column(cloud, name) for name in ("x", "z")]
    point = np.dtype(
        {
            "names": ["x", "z"],
            "formats": [order + _FORMATS[column.datatype] for column in columns],
            "offsets": [column.offset for column in columns],
            "itemsize": cloud.point_step,
        }
    )
    strides = (cloud.row_step if cloud.height > 1 else 0, cloud.point_step)
    points = np.ndarray((cloud.height, cloud.width), point, bytes(cloud.data), strides=strides).ravel()
    return points["x"].astype(np.float64), points["z"].astype(np.float64)


def coarseness_m(cloud: PointCloud2, chainage_m: FloatArray) -> float:
    """Return the smallest difference of chainages, in m, that the number format of the cloud's x can express here."""
    if not np.isfinite(chainage_m).any() or _column(cloud, "x").datatype != PointField.FLOAT32:
        return 0.0
    return float(np.spacing(np.float32(np.nanmax(np.abs(chainage_m)))))


def cloud_of(chainage_m: FloatArray, height_m: FloatArray) -> PointCloud2:
    """Return a cloud of one row; y is 0."""
    points = np.zeros(len(chainage_m), _OWN_POINT)
    points["x"], points["z"] = chainage_m, height_m
    fields = [
        PointField(name="x", offset=0, datatype=PointField.FLOAT64, count=1),
        PointField(name="y", offset=8, datatype=PointField.FLOAT32, count=1),
        PointField(name="z", offset=12, datatype=PointField.FLOAT32, count=1),
    ]
    cloud = PointCloud2(height=1, width=len(points), fields=fields, point_step=_OWN_POINT.itemsize, is_dense=True)
    cloud.row_step = points.nbytes
    cloud.is_bigendian = sys.byteorder == "big"
    cloud.data.frombytes(points.tobytes())
    return cloud


def _column(cloud: PointCloud2, name: str) -> PointField:
    for column in cloud.fields:
        if column.name == name:
            break
    else:
        raise MessageError(f"{TOPIC}: no field {name}", _REMEDY)
    if column.datatype not in _FORMATS or column.count not in (0, 1):
        raise MessageError(f"{TOPIC}: field {name} is of datatype {column.datatype}, count {column.count}", _REMEDY)
    if column.offset + np.dtype(_FORMATS[column.datatype]).itemsize > cloud.point_step:
        raise MessageError(f"{TOPIC}: field {name} ends outside the point's {cloud.point_step} bytes", _REMEDY)
    return column
