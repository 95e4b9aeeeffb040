// A bracket: a thick back plate, a thin arm with a fillet under it and a hole in it, and a block on
// the arm's end. Lengths in metres; volume "bracket", faces "wall" (the back), "end" and "hole".
SetFactory("OpenCASCADE");

DefineConstant[
  length = {0.2, Min 0.05, Max 1, Name "Parameters/1 length of the arm"},
  height = {0.1, Min 0.05, Max 1, Name "Parameters/2 height of the back plate"},
  width = {0.06, Min 0.01, Max 1, Name "Parameters/3 width"},
  arm = {0.006, Name "Parameters/4 thickness of the arm"},
  back = {0.02, Name "Parameters/5 thickness of the back plate"},
  fillet = {0.012, Name "Parameters/6 radius of the fillet"},
  hole = {0.012, Name "Parameters/7 radius of the hole in the arm"},
  block = {0.04, Name "Parameters/8 length and height of the block"},
  size = {0.012, Name "Parameters/9 size of cells"}
];

Box(1) = {-back, 0, -height, back, width, height};
Box(2) = {-back, 0, -arm, length + back, width, arm};
Box(3) = {length - block, 0, -arm, block, width, block + arm};
BooleanUnion(4) = { Volume{1}; Delete; }{ Volume{2, 3}; Delete; };

// the re-entrant edge, along y at x = 0 below the arm
e = 1e-6;
corner() = Curve In BoundingBox {-e, -e, -arm - e, e, width + e, -arm + e};
Fillet{ 4 }{ corner(0) }{ fillet }
rounded() = Volume{:};
Cylinder(10) = {0.55 * length, width / 2, -2 * arm, 0, 0, 3 * arm, hole};
BooleanDifference(11) = { Volume{ rounded(0) }; Delete; }{ Volume{10}; Delete; };

Physical Volume("bracket") = {11};
Physical Surface("wall") = Surface In BoundingBox {-back - e, -e, -height - e, -back + e, width + e, e};
Physical Surface("end") = Surface In BoundingBox {length - e, -e, -arm - e, length + e, width + e, block + e};
Physical Surface("hole") = Surface In BoundingBox {
  0.55 * length - hole - e, width / 2 - hole - e, -arm - e, 0.55 * length + hole + e, width / 2 + hole + e, e};
Mesh.MeshSizeMax = size;
