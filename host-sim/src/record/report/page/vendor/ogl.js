export { Camera, Cylinder, Geometry, Mesh, Program, Renderer, Sphere, Transform } from "ogl";
