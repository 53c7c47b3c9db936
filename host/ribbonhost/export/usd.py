"""Universal Scene Description: the surface as an animated mesh and the ribbons as animated curves."""

from pathlib import Path

import numpy as np

from ribbonhost.errors import MissingExtraError
from ribbonhost.export.animation import Animation, UpAxis, grid_normals

RIBBON_WIDTH_M = 0.008


def write_usd(animation: Animation, path: Path, up: UpAxis, metres_per_unit: float) -> None:
    """Writes .usda, .usdc or .usdz; `animation` is already scaled and turned as `up` and `metres_per_unit`
    say.

    Time codes are frames at the animation's mean rate. Raises MissingExtraError without usd-core.
    """
    try:
        from pxr import Gf, Sdf, Usd, UsdGeom, UsdUtils, Vt
    except ImportError as error:
        raise MissingExtraError(path.suffix, "usd-core", "export") from error
    layer_path = path.with_suffix(".usdc") if path.suffix == ".usdz" else path
    if path.suffix == ".usdz":
        layer_path = path.with_name(f".{path.stem}.part.usdc")
    stage = Usd.Stage.CreateNew(str(layer_path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z if up == "z" else UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, metres_per_unit)
    root = UsdGeom.Xform.Define(stage, "/ribbons")
    stage.SetDefaultPrim(root.GetPrim())
    rate = animation.rate_hz or 1.0
    codes = (animation.t_s - animation.t_s[0]) * rate
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(float(codes[-1]))

    def points(array: np.ndarray) -> object:
        return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(array.reshape(-1, 3), dtype=np.float32))

    for number, name in enumerate(animation.names):
        curve = UsdGeom.BasisCurves.Define(stage, f"/ribbons/ribbon_{number}")
        curve.GetPrim().SetMetadata("comment", name)
        curve.CreateTypeAttr(UsdGeom.Tokens.linear)
        curve.CreateCurveVertexCountsAttr([animation.node_m.shape[2]])
        curve.CreateWidthsAttr([RIBBON_WIDTH_M / metres_per_unit])
        curve.SetWidthsInterpolation(UsdGeom.Tokens.constant)
        attribute = curve.CreatePointsAttr()
        for code, p in zip(codes, animation.node_m[:, number], strict=True):
            attribute.Set(points(p), float(code))
    if animation.has_surface:
        _, u, w, _ = animation.surface_m.shape
        mesh = UsdGeom.Mesh.Define(stage, "/ribbons/surface")
        corner = (np.arange(u - 1)[:, None] * w + np.arange(w - 1)).ravel()
        quads = np.stack([corner, corner + 1, corner + w + 1, corner + w], axis=1)
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(quads), 4, np.int32)))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(quads.astype(np.int32).ravel()))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateDoubleSidedAttr(True)
        mesh.CreateDisplayColorAttr([Gf.Vec3f(0.3, 0.5, 0.8)])
        position, normal = mesh.CreatePointsAttr(), mesh.CreateNormalsAttr()
        mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        normals = grid_normals(animation.surface_m)
        for frame, code in enumerate(codes):
            position.Set(points(animation.surface_m[frame]), float(code))
            normal.Set(points(normals[frame]), float(code))
    stage.GetRootLayer().Save()
    if path.suffix == ".usdz":
        packed = UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(layer_path)), str(path))
        layer_path.unlink()
        if not packed:
            raise OSError(f"{path} could not be packed")
