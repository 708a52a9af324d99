// The studio takes megabytes: it is fetched when it is asked for, into the place of its picture.
document.addEventListener("DOMContentLoaded", () => {
  const button = document.querySelector(".toy-start");
  if (!button) return;
  button.hidden = false;
  button.addEventListener("click", () => {
    const frame = document.createElement("iframe");
    frame.src = "toy.html";
    frame.title = "The studio, with designs that are already solved";
    document.querySelector(".toy-picture").replaceWith(frame);
    button.remove();
  });
});
